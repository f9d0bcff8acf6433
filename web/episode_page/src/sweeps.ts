/** LiDAR points of the latest sweep, where they were measured in the map: one draw call, coloured by height. */

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, Points, ShaderMaterial, type Scene } from "three";
import type { Episode, SweepEntry } from "./episode";

const SHADER = {
  vertexShader: `
    varying vec3 vTint;
    void main() {
      vec4 place = modelViewMatrix * vec4(position, 1.0);
      // In front of the surface that they were measured on.
      place.xyz -= 0.15 * normalize(place.xyz);
      gl_Position = projectionMatrix * place;
      gl_PointSize = clamp(40.0 / gl_Position.w, 1.5, 4.0);
      float height = clamp((position.z + 0.3) / 6.0, 0.0, 1.0);
      vTint = mix(vec3(1.0), clamp(1.5 - abs(4.0 * height - vec3(3.0, 2.0, 1.0)), 0.0, 1.0), 0.7);
    }`,
  fragmentShader: `
    varying vec3 vTint;
    void main() { gl_FragColor = vec4(vTint, 1.0); }`,
};

/** The last of some entries that begin with a time, at or before a time; -1 before the first. */
export function latest(times: number[], time: number): number {
  return times.findLastIndex((each) => each <= time + 1e-9);
}

export class Sweeps {
  private readonly points: Points<BufferGeometry, ShaderMaterial>;
  private readonly places: BufferAttribute;
  private readonly times: number[];
  private readonly firsts: number[] = [];
  private readonly columns: Int32Array[];
  private current = -1;

  constructor(
    episode: Episode,
    lidar: number,
    private readonly entries: SweepEntry[],
    scene: Scene,
  ) {
    this.times = entries.map(([step]) => step * episode.head.step_s);
    this.columns = ["x", "y", "z"].map((axis) => episode.counts(`sweep.${lidar}.${axis}`));
    let most = 0;
    let first = 0;
    for (const [, count] of entries) {
      this.firsts.push(first);
      first += count;
      most = Math.max(most, count);
    }
    this.places = new BufferAttribute(new Float32Array(3 * most), 3).setUsage(DynamicDrawUsage);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.places);
    geometry.setDrawRange(0, 0);
    this.points = new Points(geometry, new ShaderMaterial(SHADER));
    this.points.frustumCulled = false;
    scene.add(this.points);
  }

  get shown(): boolean {
    return this.points.visible;
  }

  set shown(shown: boolean) {
    this.points.visible = shown;
  }

  /** Shows the sweep of a time. */
  place(time: number): void {
    const index = latest(this.times, time);
    if (index === this.current) return;
    this.current = index;
    if (index < 0) return this.points.geometry.setDrawRange(0, 0);
    const [, count, ...origin] = this.entries[index];
    const first = this.firsts[index];
    const places = this.places.array;
    this.columns.forEach((column, axis) => {
      for (let i = 0; i < count; i++) places[3 * i + axis] = 0.01 * column[first + i];
    });
    this.places.needsUpdate = true;
    this.points.position.set(...origin);
    this.points.geometry.setDrawRange(0, count);
  }

  /** Places of the points that are drawn, in the map. */
  drawn(): [number, number, number][] {
    const { position, geometry } = this.points;
    const places = this.places.array;
    return Array.from({ length: geometry.drawRange.count }, (_, i) => [
      position.x + places[3 * i],
      position.y + places[3 * i + 1],
      position.z + places[3 * i + 2],
    ]);
  }
}
