/** Light around lamps that shine, so that they are seen from afar: one draw call of soft round points. */

import { AdditiveBlending, BufferAttribute, BufferGeometry, DynamicDrawUsage, Points, ShaderMaterial, type Scene } from "three";
import { BEACON, BRAKE, INDICATOR_LEFT, INDICATOR_RIGHT, type Pose, type Tracks } from "./tracks";
import type { LitLens } from "./world";

const SHADER = {
  vertexShader: `
    attribute vec4 tint;
    varying vec3 vTint;
    uniform float pixels;
    void main() {
      vec4 place = modelViewMatrix * vec4(position, 1.0);
      // In front of visors and housings, through which a real lamp shines by its light on everything around.
      place.xyz -= 1.2 * normalize(place.xyz);
      vTint = tint.rgb;
      gl_Position = projectionMatrix * place;
      gl_PointSize = clamp(tint.a * pixels * projectionMatrix[1][1] / gl_Position.w, 4.0, 160.0);
    }`,
  fragmentShader: `
    varying vec3 vTint;
    void main() {
      float away = 2.0 * length(gl_PointCoord - 0.5);
      float light = pow(max(1.0 - away, 0.0), 2.0);
      gl_FragColor = vec4(vTint * light, light);
    }`,
};
const RED = [1, 0.08, 0.05];
const AMBER = [1, 0.55, 0.05];
const BLUE = [0.15, 0.4, 1];

export class Glows {
  private readonly points: Points<BufferGeometry, ShaderMaterial>;
  private readonly places: BufferAttribute;
  private readonly tints: BufferAttribute;
  private count = 0;

  constructor(private readonly tracks: Tracks, lenses: number, scene: Scene) {
    const capacity = 6 * tracks.actors.length + lenses;
    const geometry = new BufferGeometry();
    this.places = new BufferAttribute(new Float32Array(3 * capacity), 3).setUsage(DynamicDrawUsage);
    this.tints = new BufferAttribute(new Float32Array(4 * capacity), 4).setUsage(DynamicDrawUsage);
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("tint", this.tints);
    const material = new ShaderMaterial({ ...SHADER, uniforms: { pixels: { value: 1 } }, transparent: true });
    material.blending = AdditiveBlending;
    material.depthWrite = false;
    this.points = new Points(geometry, material);
    this.points.frustumCulled = false;
    scene.add(this.points);
  }

  /** Takes the light out of the scene. */
  dispose(): void {
    this.points.removeFromParent();
    this.points.geometry.dispose();
  }

  private add(x: number, y: number, z: number, rgb: readonly number[], size: number): void {
    this.places.setXYZ(this.count, x, y, z);
    this.tints.setXYZW(this.count, rgb[0], rgb[1], rgb[2], size);
    this.count++;
  }

  /** Lights the lamps of signals and of all actors but `hidden`. `pixels` is half of the picture's height. */
  place(
    poses: (Pose | undefined)[],
    hidden: number,
    lit: LitLens[],
    indicator: number,
    beacon: number,
    pixels: number,
  ): void {
    this.count = 0;
    poses.forEach((pose, index) => {
      const lights = pose ? this.tracks.lights[pose.row] : 0;
      if (!pose || lights === 0 || index === hidden) return;
      const [length, width, height] = this.tracks.actors[index].size_m;
      const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
      const lamp = (ahead: number, left: number, up: number, rgb: number[], size: number) =>
        this.add(pose.x + c * ahead - s * left, pose.y + s * ahead + c * left, pose.z + up, rgb, size);
      const [end, side, low] = [length / 2 + 0.05, width / 2 - 0.2, Math.min(0.85, 0.55 * height)];
      if (lights & BRAKE) for (const left of [side, -side]) lamp(-end, left, low, RED, 0.55);
      for (const [bit, left] of [[INDICATOR_LEFT, side], [INDICATOR_RIGHT, -side]]) {
        if (lights & bit && indicator > 0.5) for (const ahead of [end, -end]) lamp(ahead, left, low, AMBER, 0.6);
      }
      if (lights & BEACON) {
        lamp(0.15 * length, 0.3 * width, height + 0.1, BLUE, 0.6 + 1.1 * beacon);
        lamp(0.15 * length, -0.3 * width, height + 0.1, RED, 1.7 - 1.1 * beacon);
      }
    });
    for (const { place, rgb } of lit) this.add(...place, rgb, 1.4);
    this.points.geometry.setDrawRange(0, this.count);
    this.points.material.uniforms["pixels"].value = pixels;
    this.places.needsUpdate = this.tints.needsUpdate = true;
  }
}
