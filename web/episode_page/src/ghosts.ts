/** Another episode drawn into this one: its actors as pale bodies, where they are elsewhere than in this one. */

import { Color, Matrix4, Vector3, type Scene } from "three";
import { Instances, plainBody } from "./fleet";
import type { Other } from "./other";
import { tintedMaterial } from "./tinted";
import type { Pose } from "./tracks";

const APART_M = 0.5;
const PAINTS = ["#8fd0ff", "#d3b4ff", "#ffd98a"];

export class Ghosts {
  shown = true;
  private readonly bodies: Instances;
  private readonly paint: Color;
  private readonly pose: Pose = { x: 0, y: 0, z: 0, yaw: 0, row: 0 };
  private readonly matrix = new Matrix4();

  constructor(
    readonly other: Other,
    scene: Scene,
  ) {
    const material = tintedMaterial({ indicator: { value: 0 }, beacon: { value: 0 } });
    this.paint = new Color(PAINTS[other.number - 2]);
    material.transparent = true;
    material.opacity = 0.55;
    material.emissive.copy(this.paint).multiplyScalar(0.4);
    material.depthWrite = false;
    this.bodies = new Instances(plainBody(), material, other.tracks.actors.length, new Vector3(1, 1, 1));
    scene.add(this.bodies.mesh);
  }

  /** Places the bodies at the time of the other's tracks, next to the actors of this episode. */
  place(poses: (Pose | undefined)[]): void {
    const { tracks, here } = this.other;
    this.bodies.mesh.count = 0;
    tracks.actors.forEach(({ size_m: [length, width, height] }, index) => {
      if (!this.shown || !tracks.pose(index, this.pose)) return;
      const { x, y, z, yaw } = this.pose;
      const twin = poses[here[index]];
      if (twin && Math.hypot(twin.x - x, twin.y - y) < APART_M) return;
      const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
      this.matrix.set(c * length, -s * width, 0, x, s * length, c * width, 0, y, 0, 0, height, z, 0, 0, 0, 1);
      this.bodies.add(index, this.matrix, this.paint, 0);
    });
    this.bodies.finish();
  }

  /** Ids of the bodies that are drawn, with their places. */
  drawn(): { id: number; x: number; y: number }[] {
    return Array.from({ length: this.bodies.mesh.count }, (_, i) => {
      const place = this.bodies.mesh.instanceMatrix.array.subarray(16 * i + 12, 16 * i + 14);
      return { id: this.other.tracks.actors[this.bodies.actors[i]].id, x: place[0], y: place[1] };
    });
  }
}
