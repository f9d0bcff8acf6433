/** The part of the address after `#`: time, actor and camera, so that people can send each other a moment. */

import { CAMERAS, type CameraName } from "./cameras";

export interface Moment {
  time?: number;
  actor?: number;
  camera?: CameraName;
}

/** Reads `#t=12.5&v=3&c=above`; what is missing or no value is left out. */
export function readMoment(hash: string): Moment {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (name: string) => (parts.has(name) ? Number(parts.get(name) || NaN) : NaN);
  const [time, actor] = [number("t"), number("v")];
  const camera = CAMERAS.find((name) => name === parts.get("c"));
  return {
    ...(Number.isFinite(time) ? { time } : {}),
    ...(Number.isInteger(actor) ? { actor } : {}),
    ...(camera ? { camera } : {}),
  };
}

export function writeMoment(time: number, actor: number, camera: CameraName): string {
  return `#t=${time.toFixed(2)}&v=${actor}&c=${camera}`;
}
