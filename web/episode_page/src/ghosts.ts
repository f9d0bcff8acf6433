/** Another episode on the same map and clock: its actors as pale bodies, where they are elsewhere than in this one. */

import { Color, Matrix4, Vector3, type Scene } from "three";
import type { Against, Episode } from "./episode";
import { Instances, plainBody } from "./fleet";
import { tintedMaterial } from "./tinted";
import { Tracks, type Pose } from "./tracks";

const APART_M = 0.5;
const KMH = 3.6;
const PAINT = new Color("#8fd0ff");

export class Ghosts {
  readonly tracks: Tracks;
  shown = true;
  private readonly bodies: Instances;
  /** By the actors of the other episode and of this one: the actor of the same name in the one not asked; -1 for none. */
  private readonly here: number[];
  private readonly there: number[];
  private readonly pose: Pose = { x: 0, y: 0, z: 0, yaw: 0, row: 0 };
  private readonly matrix = new Matrix4();

  constructor(episode: Episode, against: Against, main: Tracks, scene: Scene) {
    this.tracks = new Tracks(episode, against.actors, against.emvs, "against.");
    const named = (tracks: Tracks) => new Map(tracks.actors.map(({ name }, index) => [name, index]));
    const [names, ownNames] = [named(this.tracks), named(main)];
    this.here = this.tracks.actors.map(({ name }) => ownNames.get(name) ?? -1);
    this.there = main.actors.map(({ name }) => names.get(name) ?? -1);
    const material = tintedMaterial({ indicator: { value: 0 }, beacon: { value: 0 } });
    material.transparent = true;
    material.opacity = 0.55;
    material.emissive.set("#2f6ea3");
    material.depthWrite = false;
    this.bodies = new Instances(plainBody(), material, this.tracks.actors.length, new Vector3(1, 1, 1));
    scene.add(this.bodies.mesh);
  }

  /** Places the bodies at a time, next to the actors of this episode. */
  place(time: number, poses: (Pose | undefined)[]): void {
    this.bodies.mesh.count = 0;
    this.tracks.setTime(time);
    this.tracks.actors.forEach(({ size_m: [length, width, height] }, index) => {
      if (!this.shown || !this.tracks.pose(index, this.pose)) return;
      const { x, y, z, yaw } = this.pose;
      const twin = poses[this.here[index]];
      if (twin && Math.hypot(twin.x - x, twin.y - y) < APART_M) return;
      const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
      this.matrix.set(c * length, -s * width, 0, x, s * length, c * width, 0, y, 0, 0, height, z, 0, 0, 0, 1);
      this.bodies.add(index, this.matrix, PAINT, 0);
    });
    this.bodies.finish();
  }

  /** The actor of the same name in the other episode; -1 for none. */
  twinOf(index: number): number {
    return this.there[index] ?? -1;
  }

  /** What the actor of the same name does at the time of the latest picture, as seen by an actor of this episode. */
  description(index: number, own: Pose | undefined): string {
    const twin = this.twinOf(index);
    if (twin < 0 || !own || !this.tracks.pose(twin, this.pose)) return "not there";
    const [dx, dy] = [this.pose.x - own.x, this.pose.y - own.y];
    const [c, s] = [Math.cos(own.yaw), Math.sin(own.yaw)];
    const apart = Math.hypot(dx, dy);
    const where = apart < 0.05 ? "same place" : `${apart.toFixed(1)} m ${direction(c * dx + s * dy, c * dy - s * dx)}`;
    return `${(this.tracks.speed[this.pose.row] * KMH).toFixed(1)} km/h, ${where}`;
  }

  /** Ids of the bodies that are drawn, with their places. */
  drawn(): { id: number; x: number; y: number }[] {
    return Array.from({ length: this.bodies.mesh.count }, (_, i) => {
      const place = this.bodies.mesh.instanceMatrix.array.subarray(16 * i + 12, 16 * i + 14);
      return { id: this.tracks.actors[this.bodies.actors[i]].id, x: place[0], y: place[1] };
    });
  }
}

function direction(ahead: number, left: number): string {
  if (Math.abs(ahead) >= Math.abs(left)) return ahead > 0 ? "ahead" : "behind";
  return left > 0 ? "to the left" : "to the right";
}
