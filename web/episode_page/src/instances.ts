/** Shapes that are drawn many times: where each of them is stands in one block for all, as one upload of a picture. */

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  Mesh,
  Vector3,
  type Material,
} from "three";
import type { Pose } from "./tracks";

/** Numbers of an instance, as `PLACED` names them. */
const LAYOUT = [["place", 4], ["scale", 4], ["paint", 4], ["rolled", 1]] as const;
const STRIDE = 13;

/** For vertex shaders: a point of an instance in the scene. */
export const PLACED = `
attribute vec4 place;   // x, y, z, heading
attribute vec4 scale;   // along the three axes; state of lamps, or kind of a mark
attribute vec4 paint;   // red, green, blue; steering angle
attribute float rolled; // way
vec3 placed(vec3 point) {
  point *= scale.xyz;
  float c = cos(place.w), s = sin(place.w);
  return place.xyz + vec3(c * point.x - s * point.y, s * point.x + c * point.y, point.z);
}`;

/** Room for some instances. */
export function newBlock(capacity: number): InstancedInterleavedBuffer {
  return new InstancedInterleavedBuffer(new Float32Array(STRIDE * capacity), STRIDE).setUsage(DynamicDrawUsage);
}

/** Instances of one shape, and which actor each of them is. */
export class Instances {
  readonly mesh: Mesh<InstancedBufferGeometry>;
  readonly actors: Int32Array;
  readonly triangles: number;
  count = 0;

  constructor(
    shape: BufferGeometry,
    material: Material,
    private readonly block: InstancedInterleavedBuffer,
    /** Its part of the block. */
    private readonly first: number,
    capacity: number,
    /** Size of the shape, to which actors' sizes are compared. */
    readonly size: Vector3,
  ) {
    const geometry = new InstancedBufferGeometry().setIndex(shape.index) as InstancedBufferGeometry;
    for (const [name, attribute] of Object.entries(shape.attributes)) geometry.setAttribute(name, attribute);
    let offset = STRIDE * first;
    for (const [name, width] of LAYOUT) {
      geometry.setAttribute(name, new InterleavedBufferAttribute(block, width, offset));
      offset += width;
    }
    this.mesh = new Mesh(geometry, material);
    this.mesh.frustumCulled = false;
    this.actors = new Int32Array(capacity);
    this.triangles = (geometry.index?.count ?? 0) / 3;
  }

  /** Adds an actor with a size; `state` is that of its lamps. */
  add(actor: number, pose: Pose, length: number, width: number, height: number, paint: Color, state: number, above = 0): void {
    const { array } = this.block;
    let at = STRIDE * (this.first + this.count);
    this.actors[this.count++] = actor;
    array[at++] = pose.x;
    array[at++] = pose.y;
    array[at++] = pose.z + above;
    array[at++] = pose.yaw;
    array[at++] = length / this.size.x;
    array[at++] = width / this.size.y;
    array[at++] = height / this.size.z;
    array[at++] = state;
    array[at++] = paint.r;
    array[at++] = paint.g;
    array[at++] = paint.b;
    array[at++] = pose.steer;
    array[at] = pose.rolled;
  }

  /** Hands the instances to the graphics card. */
  finish(): void {
    this.mesh.visible = this.count > 0;
    this.mesh.geometry.instanceCount = this.count;
    this.block.needsUpdate = true;
  }

  /** What was handed over: the actors' places and poses. */
  drawn() {
    return Array.from({ length: this.count }, (_, i) => {
      const at = STRIDE * (this.first + i);
      const [x, y, z, yaw] = this.block.array.subarray(at, at + 4);
      return { index: this.actors[i], x, y, z, yaw, steer: this.block.array[at + 11], rolled: this.block.array[at + 12] };
    });
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
  geometry.setAttribute("hub", new BufferAttribute(new Float32Array((4 / 3) * places.length), 4));
  geometry.setIndex(index);
  return geometry;
}
