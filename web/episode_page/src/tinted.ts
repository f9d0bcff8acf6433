/** The material of everything solid: colours at the vertices, paint of each instance, and lamps that shine. */

import {
  BufferAttribute,
  BufferGeometry,
  MeshLambertMaterial,
  type IUniform,
  type Vector3,
  type WebGLProgramParametersWithUniforms,
} from "three";
import type { Episode } from "./episode";
import { PLACED } from "./instances";

const made = new Map<string, BufferGeometry>();

/** Red, green, blue and the code of the surface at each vertex, sRGB. The page's episodes share it. */
export function geometryOf(episode: Episode, name: string): BufferGeometry {
  const known = made.get(name);
  if (known) return known;
  const xyz = episode.numbers(`${name}.xyz`);
  const rgb = episode.counts(`${name}.rgb`);
  const surface = episode.counts(`${name}.surface`);
  const part = episode.counts(`${name}.part`);
  const count = rgb.length;
  const places = new Float32Array(3 * count);
  const tint = new Uint8Array(4 * count);
  for (let i = 0; i < count; i++) {
    for (let axis = 0; axis < 3; axis++) places[3 * i + axis] = xyz[axis * count + i];
    tint.set([rgb[i] >> 16, (rgb[i] >> 8) & 255, rgb[i] & 255, surface[i] ?? 0], 4 * i);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(places, 3));
  geometry.setAttribute("tint", new BufferAttribute(tint, 4, true));
  const hubs = episode.numbers(`${name}.hubs`);
  const hub = Float32Array.from({ length: hubs.length && 4 * count }, (_, i) => hubs[4 * part[i >> 2] + (i & 3)]);
  if (hubs.length) geometry.setAttribute("hub", new BufferAttribute(hub, 4));
  geometry.setIndex(new BufferAttribute(new Uint32Array(episode.counts(`${name}.triangles`)), 1));
  made.set(name, geometry);
  return geometry;
}

/** Whether lamps that flash are in the bright part of their period. */
export interface Flashing {
  indicator: IUniform<number>;
  beacon: IUniform<number>;
}

const VERTEX_HEAD = `
attribute vec4 tint;
varying vec3 vTint;
varying vec3 vGlow;
varying float vHeight;
#ifdef INSTANCES
${PLACED}
attribute vec4 hub;
uniform float indicator;
uniform float beacon;
#endif
void main() {
  vTint = pow(tint.rgb, vec3(2.2));
  vGlow = vec3(0.0);
  vHeight = tint.a > 0.0 ? 0.0 : position.z;
  #ifdef INSTANCES
  int surface = int(tint.a * 255.0 + 0.5);
  int lit = int(scale.w + 0.5);
  if (surface == 1) vTint *= pow(paint.rgb, vec3(2.2));
  if (surface == 2 && (lit & 1) != 0) vGlow = vec3(2.2, 0.05, 0.05);
  if (surface == 3 && (lit & 2) != 0) vGlow = vec3(2.0, 0.8, 0.05) * indicator;
  if (surface == 4 && (lit & 4) != 0) vGlow = vec3(2.0, 0.8, 0.05) * indicator;
  if (surface == 5 && (lit & 8) != 0) vGlow = vec3(0.1, 0.4, 3.0) * beacon;
  if (surface == 6 && (lit & 8) != 0) vGlow = vec3(3.0, 0.1, 0.1) * (1.25 - beacon);
  #endif`;

/** Turns a wheel about its hub, or a limb about its joint, with the way that is rolled; as the sensors' cameras draw them. */
const VERTEX_PLACE = `
vec3 transformed = position;
#ifdef INSTANCES
if (hub.w > 0.5) {
  float roll = rolled / hub.z;
  if (hub.w > 2.5) {
    vec2 swing = hub.w > 4.5 ? vec2(-0.3, 4.2) : hub.w > 3.5 ? vec2(0.24, 1.26) : vec2(0.42, 4.2);
    roll = sign(hub.y) * swing.x * sin(rolled * swing.y);
  }
  vec3 arm = position - hub.xyz;
  arm.xz = mat2(cos(roll), -sin(roll), sin(roll), cos(roll)) * arm.xz;
  float steer = hub.w > 1.5 && hub.w < 2.5 ? paint.w : 0.0;
  arm.xy = mat2(cos(steer), sin(steer), -sin(steer), cos(steer)) * arm.xy;
  transformed = hub.xyz + arm;
}
transformed = placed(transformed);
#endif`;

/**
 * What stands higher than the road between the camera and this place, in the camera's frame, is cut away, but for what has
 * a surface of its own; at the origin, nothing is.
 */
export interface Focus {
  focus: IUniform<Vector3>;
}

const FRAGMENT_HEAD = `
varying vec3 vTint;
varying vec3 vGlow;
varying float vHeight;
#ifndef INSTANCES
uniform vec3 focus;
#endif
void main() {
  #ifndef INSTANCES
  float along = dot(-vViewPosition, focus) / max(dot(focus, focus), 1e-6);
  float aside = length(-vViewPosition - along * focus);
  if (dot(focus, focus) > 0.0 && vHeight > 0.4 && along < 0.94 && aside < 9.0 * along) discard;
  #endif`;

export function tintedMaterial(uniforms: Flashing | Focus): MeshLambertMaterial {
  const instances = "beacon" in uniforms;
  const material = new MeshLambertMaterial({ flatShading: true });
  if (instances) material.defines = { INSTANCES: "" };
  material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("void main() {", VERTEX_HEAD)
      .replace("#include <begin_vertex>", VERTEX_PLACE);
    shader.fragmentShader = shader.fragmentShader
      .replace("void main() {", FRAGMENT_HEAD)
      .replace("#include <color_fragment>", "diffuseColor.rgb *= vTint;")
      .replace("#include <emissivemap_fragment>", "totalEmissiveRadiance += vGlow;");
  };
  material.customProgramCacheKey = () => (instances ? "instances" : "static");
  return material;
}
