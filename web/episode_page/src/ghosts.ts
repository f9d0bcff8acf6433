/** Another episode drawn into this one: its actors as pale bodies, where they are elsewhere than in this one. */

import { Color, Vector3, type Scene } from "three";
import { Instances, newBlock, plainBody } from "./instances";
import type { Other } from "./other";
import { tintedMaterial } from "./tinted";
import { newPose, type Pose } from "./tracks";

const APART_M = 0.5;
const PAINTS = ["#8fd0ff", "#d3b4ff", "#ffd98a"];

export class Ghosts {
  shown = true;
  private readonly bodies: Instances;
  private readonly paint: Color;
  private readonly pose = newPose();

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
    const count = other.tracks.actors.length;
    this.bodies = new Instances(plainBody(), material, newBlock(count), 0, count, new Vector3(1, 1, 1));
    scene.add(this.bodies.mesh);
  }

  /** Places the bodies at the time of the other's tracks, next to the actors of this episode. */
  place(poses: (Pose | undefined)[]): void {
    const { tracks, here } = this.other;
    this.bodies.count = 0;
    tracks.actors.forEach(({ size_m: [length, width, height] }, index) => {
      if (!this.shown || !tracks.pose(index, this.pose)) return;
      const twin = poses[here[index]];
      if (twin && Math.hypot(twin.x - this.pose.x, twin.y - this.pose.y) < APART_M) return;
      this.bodies.add(index, this.pose, length, width, height, this.paint, 0);
    });
    this.bodies.finish();
  }

  /** Ids of the bodies that are drawn, with their places. */
  drawn(): { id: number; x: number; y: number }[] {
    return this.bodies.drawn().map(({ index, x, y }) => ({ id: this.other.tracks.actors[index].id, x, y }));
  }
}
