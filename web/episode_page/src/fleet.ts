/** The actors as instances: the nearest in full detail, others as plain bodies, each on its mark on the ground. */

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedMesh,
  Matrix4,
  PlaneGeometry,
  Ray,
  ShaderMaterial,
  Vector3,
  type IUniform,
  type Material,
  type Scene,
} from "three";
import type { Episode } from "./episode";
import { geometryOf, tintedMaterial } from "./tinted";
import type { Pose, Tracks } from "./tracks";

const DETAILED_TRIANGLES = 90_000;
const DETAILED_WITHIN_M = 300;
const MARK_M = 0.45;
/** Added on each side of a footprint, so that small and distant actors can be hit. */
const REACH_M = 0.25;

/** Instances of one geometry, and which actor each of them is. */
export class Instances {
  readonly mesh: InstancedMesh;
  readonly geometry: BufferGeometry;
  readonly actors: Int32Array;
  readonly triangles: number;

  constructor(
    shape: BufferGeometry,
    material: Material,
    capacity: number,
    /** Size of the geometry, to which actors' sizes are compared. */
    readonly size: Vector3,
  ) {
    const geometry = (this.geometry = new BufferGeometry().setIndex(shape.index));
    for (const [name, attribute] of Object.entries(shape.attributes)) geometry.setAttribute(name, attribute);
    for (const [name, width] of [["paint", 3], ["lights", 1]] as const) {
      const attribute = new InstancedBufferAttribute(new Float32Array(width * capacity), width);
      geometry.setAttribute(name, attribute.setUsage(DynamicDrawUsage));
    }
    this.mesh = new InstancedMesh(geometry, material, capacity);
    this.mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    this.mesh.frustumCulled = false;
    this.actors = new Int32Array(capacity);
    this.triangles = (geometry.index?.count ?? 0) / 3;
  }

  add(actor: number, matrix: Matrix4, paint: Color, lights: number): void {
    const at = this.mesh.count++;
    this.actors[at] = actor;
    this.mesh.setMatrixAt(at, matrix);
    this.geometry.getAttribute("paint").setXYZ(at, paint.r, paint.g, paint.b);
    this.geometry.getAttribute("lights").setX(at, lights);
  }

  /** Hands the instances to the graphics card. */
  finish(): void {
    this.mesh.visible = this.mesh.count > 0;
    this.mesh.instanceMatrix.needsUpdate = true;
    this.geometry.getAttribute("paint").needsUpdate = true;
    this.geometry.getAttribute("lights").needsUpdate = true;
  }
}

/** A body with a narrower cabin, one unit long, wide and high. */
export function plainBody(): BufferGeometry {
  const places: number[] = [];
  const tint: number[] = [];
  const index: number[] = [];
  const add = (low: number[], high: number[], inset: number, colour: number[]) => {
    const first = places.length / 3;
    for (const [z, d] of [[low[2], 0], [high[2], inset]]) {
      places.push(low[0] + d, low[1] + d, z, high[0] - d, low[1] + d, z, high[0] - d, high[1] - d, z, low[0] + d, high[1] - d, z);
    }
    for (let i = 0; i < 8; i++) tint.push(...colour);
    for (const [a, b, c, d] of [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]]) {
      index.push(first + a, first + b, first + c, first + a, first + c, first + d);
    }
  };
  add([-0.5, -0.5, 0.1], [0.5, 0.5, 0.6], 0, [255, 255, 255, 1]);
  add([-0.38, -0.44, 0.6], [0.25, 0.44, 1], 0.06, [60, 70, 80, 0]);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(places), 3));
  geometry.setAttribute("tint", new BufferAttribute(new Uint8Array(tint), 4, true));
  geometry.setIndex(index);
  return geometry;
}

/** A soft shadow under each actor, with a frame in the colour of its mode, and a wider one around the selected actor. */
const MARK = {
  vertexShader: `
    attribute vec3 paint;
    attribute float lights;
    varying vec2 vPlace;
    varying vec2 vHalf;
    varying vec4 vFrame;
    void main() {
      vHalf = vec2(length(instanceMatrix[0].xyz), length(instanceMatrix[1].xyz)) * 0.5;
      vPlace = position.xy * 2.0 * vHalf;
      vFrame = vec4(paint, lights);
      gl_Position = projectionMatrix * modelViewMatrix * instanceMatrix * vec4(position, 1.0);
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
  private readonly matrix = new Matrix4();
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
    for (const [name, count] of counts) {
      const geometry = geometryOf(episode, `shape.${name}`);
      geometry.computeBoundingBox();
      const size = geometry.boundingBox?.getSize(new Vector3()) ?? new Vector3(1, 1, 1);
      this.kinds.set(name, new Instances(geometry, material, count, size));
    }
    this.plain = new Instances(plainBody(), material, actors.length, new Vector3(1, 1, 1));
    const ground = new ShaderMaterial({ ...MARK, transparent: true, depthWrite: false, polygonOffset: true });
    ground.polygonOffsetFactor = ground.polygonOffsetUnits = -2;
    this.marks = new Instances(new PlaneGeometry(1, 1), ground, actors.length, new Vector3(1, 1, 1));
    this.paints = actors.map((actor) =>
      new Color((actor.rgb >> 16) / 255, ((actor.rgb >> 8) & 255) / 255, (actor.rgb & 255) / 255));
    this.order = actors.map((_, index) => index);
    this.distances = new Float64Array(actors.length);
    this.store = actors.map(() => ({ x: 0, y: 0, z: 0, yaw: 0, row: 0 }));
    this.poses = actors.map(() => undefined);
    for (const each of this.all()) scene.add(each.mesh);
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
    for (const each of this.all()) each.mesh.count = 0;
    this.poses.forEach((pose, index) => {
      this.distances[index] = pose ? (pose.x - eye.x) ** 2 + (pose.y - eye.y) ** 2 + (pose.z - eye.z) ** 2 : Infinity;
    });
    this.order.sort((a, b) => this.distances[a] - this.distances[b]);
    let triangles = 0;
    for (const index of this.order) {
      const pose = this.poses[index];
      if (!pose) break;
      if (index === hidden) continue;
      const kind = this.kinds.get(this.tracks.actors[index].class) ?? this.plain;
      const near = this.distances[index] < DETAILED_WITHIN_M ** 2 && triangles + kind.triangles <= share * DETAILED_TRIANGLES;
      const shape = near ? kind : this.plain;
      triangles += near ? kind.triangles : 0;
      const [length, width, height] = this.tracks.actors[index].size_m;
      const lights = this.tracks.lights[pose.row];
      this.turn(pose, length / shape.size.x, width / shape.size.y, height / shape.size.z, 0);
      shape.add(index, this.matrix, this.paints[index], lights);
      const colour = index === selected ? "#ffffff" : this.tracks.modeColour(index, pose.row);
      this.turn(pose, length + 4 * MARK_M, width + 4 * MARK_M, 1, 0.03);
      this.marks.add(index, this.matrix, FRAME.setStyle(colour ?? "#000000", ""), index === selected ? 2 : colour ? 1 : 0);
    }
    for (const each of this.all()) each.finish();
  }

  private turn(pose: Pose, sx: number, sy: number, sz: number, above: number): void {
    const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
    this.matrix.set(c * sx, -s * sy, 0, pose.x, s * sx, c * sy, 0, pose.y, 0, 0, sz, pose.z + above, 0, 0, 0, 1);
  }

  /** The nearest actor that a ray hits; -1 for none. */
  hit(ray: Ray): number {
    const { origin, direction } = ray;
    let [best, nearest] = [-1, Infinity];
    this.poses.forEach((pose, index) => {
      if (!pose) return;
      const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
      const [dx, dy] = [origin.x - pose.x, origin.y - pose.y];
      const [length, width, height] = this.tracks.actors[index].size_m;
      const reach = REACH_M + 0.004 * Math.hypot(dx, dy, origin.z - pose.z);
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

  /** What was given to the graphics card: id, place and heading of every actor. */
  drawn(): { id: number; x: number; y: number; z: number; yaw: number }[] {
    const found: { id: number; x: number; y: number; z: number; yaw: number }[] = [];
    for (const each of [...this.kinds.values(), this.plain]) {
      for (let i = 0; i < each.mesh.count; i++) {
        const m = each.mesh.instanceMatrix.array.subarray(16 * i, 16 * i + 16);
        const id = this.tracks.actors[each.actors[i]].id;
        found.push({ id, x: m[12], y: m[13], z: m[14], yaw: Math.atan2(m[1], m[0]) });
      }
    }
    return found;
  }
}

const FRAME = new Color();
