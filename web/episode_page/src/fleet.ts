/** The actors as instances: the nearest in full detail, others as plain bodies, each on its mark on the ground. */

import { Color, PlaneGeometry, ShaderMaterial, Vector3, type BufferGeometry, type IUniform, type Material, type Ray, type Scene } from "three";
import type { Episode } from "./episode";
import { Instances, newBlock, PLACED, plainBody } from "./instances";
import { geometryOf, tintedMaterial } from "./tinted";
import { newPose, type Pose, type Tracks } from "./tracks";

const DETAILED_TRIANGLES = 90_000;
const DETAILED_WITHIN_M = 300;
const MARK_M = 0.45;
/** Added on each side of a footprint, so that small and distant actors can be hit. */
const REACH_M = 0.25;

/** A soft shadow under each actor, with a frame in the colour of its mode, and a wider one around the selected actor. */
const MARK = {
  vertexShader: `
    ${PLACED}
    varying vec2 vPlace;
    varying vec2 vHalf;
    varying vec4 vFrame;
    void main() {
      vHalf = scale.xy * 0.5;
      vPlace = position.xy * 2.0 * vHalf;
      vFrame = vec4(paint.rgb, scale.w);
      gl_Position = projectionMatrix * modelViewMatrix * vec4(placed(position), 1.0);
    }`,
  fragmentShader: `
    varying vec2 vPlace;
    varying vec2 vHalf;
    varying vec4 vFrame;
    void main() {
      vec2 beyond = abs(vPlace) - vHalf + ${(2 * MARK_M).toFixed(2)};
      float edge = length(max(beyond, 0.0)) + min(max(beyond.x, beyond.y), 0.0) - ${MARK_M.toFixed(2)};
      float shadow = 0.42 * (1.0 - smoothstep(-0.6, 0.25, edge));
      float width = vFrame.a > 1.5 ? 0.22 : 0.16;
      float frame = min(vFrame.a, 1.0) * (1.0 - smoothstep(width - 0.06, width, abs(edge)));
      gl_FragColor = vec4(mix(vec3(0.0), vFrame.rgb, frame), max(shadow, frame));
      if (gl_FragColor.a < 0.01) discard;
    }`,
};

export class Fleet {
  private readonly kinds = new Map<string, Instances>();
  private readonly plain: Instances;
  private readonly marks: Instances;
  private readonly paints: Color[];
  private readonly order: number[];
  private readonly distances: Float64Array;
  /** Poses of the actors that are there, by their place; undefined for those that are not. */
  readonly poses: (Pose | undefined)[];
  private readonly store: Pose[];
  private readonly frames = new Map<string, Color>();
  readonly indicator: IUniform<number> = { value: 1 };
  readonly beacon: IUniform<number> = { value: 1 };

  constructor(
    episode: Episode,
    private readonly tracks: Tracks,
    scene: Scene,
  ) {
    const actors = tracks.actors;
    const material = tintedMaterial({ indicator: this.indicator, beacon: this.beacon });
    const counts = new Map<string, number>();
    for (const actor of actors) counts.set(actor.class, (counts.get(actor.class) ?? 0) + 1);
    const block = newBlock(3 * actors.length);
    let first = 0;
    const add = (shape: BufferGeometry, material: Material, count: number, size = new Vector3(1, 1, 1)) => {
      first += count;
      return new Instances(shape, material, block, first - count, count, size);
    };
    for (const [name, count] of counts) {
      const geometry = geometryOf(episode, `shape.${name}`);
      geometry.computeBoundingBox();
      this.kinds.set(name, add(geometry, material, count, geometry.boundingBox?.getSize(new Vector3())));
    }
    this.plain = add(plainBody(), material, actors.length);
    const ground = new ShaderMaterial({ ...MARK, transparent: true, depthWrite: false, polygonOffset: true });
    ground.polygonOffsetFactor = ground.polygonOffsetUnits = -2;
    this.marks = add(new PlaneGeometry(1, 1), ground, actors.length);
    this.paints = actors.map((actor) =>
      new Color((actor.rgb >> 16) / 255, ((actor.rgb >> 8) & 255) / 255, (actor.rgb & 255) / 255));
    this.order = actors.map((_, index) => index);
    this.distances = new Float64Array(actors.length);
    this.store = actors.map(newPose);
    this.poses = actors.map(() => undefined);
    for (const each of this.all()) scene.add(each.mesh);
  }

  /** Takes the actors out of the scene. */
  dispose(): void {
    for (const { mesh } of this.all()) {
      mesh.removeFromParent();
      mesh.geometry.dispose();
    }
  }

  private *all(): Iterable<Instances> {
    yield* this.kinds.values();
    yield this.plain;
    yield this.marks;
  }

  /** Finds where all actors are at the time that the tracks have. */
  locate(): void {
    this.store.forEach((pose, index) => {
      this.poses[index] = this.tracks.pose(index, pose) ? pose : undefined;
    });
  }

  /** Places the instances for a camera, with `share` of the triangles. */
  place(eye: Vector3, selected: number, hidden: number, share: number): void {
    const { tracks, poses, distances } = this;
    for (const each of this.all()) each.count = 0;
    for (let index = 0; index < poses.length; index++) {
      const pose = poses[index];
      distances[index] = pose ? (pose.x - eye.x) ** 2 + (pose.y - eye.y) ** 2 + (pose.z - eye.z) ** 2 : Infinity;
    }
    this.order.sort((a, b) => distances[a] - distances[b]);
    let triangles = 0;
    for (const index of this.order) {
      const pose = poses[index];
      if (!pose) break;
      if (index === hidden) continue;
      const kind = this.kinds.get(tracks.actors[index].class) ?? this.plain;
      const near = distances[index] < DETAILED_WITHIN_M ** 2 && triangles + kind.triangles <= share * DETAILED_TRIANGLES;
      triangles += near ? kind.triangles : 0;
      const [length, width, height] = tracks.actors[index].size_m;
      const shape = near ? kind : this.plain;
      shape.add(index, pose, length, width, height, this.paints[index], tracks.lights[pose.row]);
      const colour = index === selected ? "#ffffff" : tracks.modeColour(index, pose.row);
      const kindOfFrame = index === selected ? 2 : colour ? 1 : 0;
      this.marks.add(index, pose, length + 4 * MARK_M, width + 4 * MARK_M, 1, this.frame(colour), kindOfFrame, 0.03);
    }
    for (const each of this.all()) each.finish();
  }

  /** Colour of a frame. */
  private frame(colour = "#000000"): Color {
    const known = this.frames.get(colour) ?? new Color().setStyle(colour, "");
    this.frames.set(colour, known);
    return known;
  }

  /** The nearest actor that a ray hits or, without any, that it almost hits; -1 for none. */
  hit(ray: Ray): number {
    const exact = this.nearest(ray, 0);
    return exact < 0 ? this.nearest(ray, 1) : exact;
  }

  /** With `share` of the reach around footprints. */
  private nearest({ origin, direction }: Ray, share: number): number {
    let [best, nearest] = [-1, Infinity];
    this.poses.forEach((pose, index) => {
      if (!pose) return;
      const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
      const [dx, dy] = [origin.x - pose.x, origin.y - pose.y];
      const [length, width, height] = this.tracks.actors[index].size_m;
      const reach = share * (REACH_M + 0.004 * Math.hypot(dx, dy, origin.z - pose.z));
      const start = [c * dx + s * dy, c * dy - s * dx, origin.z - pose.z];
      const along = [c * direction.x + s * direction.y, c * direction.y - s * direction.x, direction.z];
      const low = [-length / 2 - reach, -width / 2 - reach, 0];
      const high = [length / 2 + reach, width / 2 + reach, height + reach];
      let [enter, leave] = [0, Infinity];
      for (let axis = 0; axis < 3; axis++) {
        const [a, b] = [(low[axis] - start[axis]) / along[axis], (high[axis] - start[axis]) / along[axis]];
        enter = Math.max(enter, Math.min(a, b));
        leave = Math.min(leave, Math.max(a, b));
      }
      if (enter <= leave && enter < nearest) [best, nearest] = [index, enter];
    });
    return best;
  }

  /** What was given to the graphics card: id and pose of every actor. */
  drawn() {
    const found = [...this.kinds.values(), this.plain].flatMap((each) => each.drawn());
    return found.map(({ index, ...pose }) => ({ id: this.tracks.actors[index].id, ...pose }));
  }
}
