/** Where actors are at any time: between two frames on the straight line, with the shorter turn. */

import type { Actor, Episode, Part } from "./episode";

export interface Pose {
  x: number;
  y: number;
  z: number;
  yaw: number;
  /** Angle of the front wheels, left positive. */
  steer: number;
  /** Way that it has gone since it was first there. */
  rolled: number;
  /** Row of the columns: the frame at or before the time. */
  row: number;
}

const ABSENT = 255;
const NOTHING = 9998;
export const BRAKE = 1;
export const INDICATOR_LEFT = 2;
export const INDICATOR_RIGHT = 4;
export const BEACON = 8;
export const SIREN = 16;

export function newPose(): Pose {
  return { x: 0, y: 0, z: 0, yaw: 0, steer: 0, rolled: 0, row: 0 };
}

export class Tracks {
  /** Time of each frame, in seconds. */
  readonly times: Float64Array;
  readonly speed: Float64Array;
  readonly accel: Float64Array;
  readonly residual: Float64Array;
  /** Of EMVs: least time to collision and least gap to another actor; no number where there is none. */
  readonly ttc: Float64Array;
  readonly gap: Float64Array;
  /** Of EMVs: the time lost against free flow since the begin. */
  readonly delay: Float64Array;
  readonly owner: Int32Array;
  readonly lights: Int32Array;
  readonly mode: Int32Array;
  readonly x: Float64Array;
  readonly y: Float64Array;
  private readonly z: Float64Array;
  private readonly yaw: Float64Array;
  private readonly steer: Float64Array;
  private readonly rolled: Float64Array;
  private readonly firstRow: number[] = [];
  private readonly indices = new Map<number, number>();
  /** Places in `actors`. */
  readonly emvs: number[];
  private frame = 0;
  private share = 0;

  readonly actors: Actor[];

  constructor(private readonly episode: Episode, { actors, emvs, prefix }: Part) {
    this.actors = actors;
    this.times = episode.numbers(`${prefix}frame.step`).map((step) => step * episode.head.step_s);
    const column = (name: string) => episode.numbers(`${prefix}motion.${name}`);
    [this.x, this.y, this.z, this.yaw] = [column("x_m"), column("y_m"), column("z_m"), column("yaw_rad")];
    [this.speed, this.accel, this.residual] = [column("speed_mps"), column("accel_mps2"), column("residual_m")];
    this.steer = column("steer_rad");
    const orNone = (value: number) => (value >= NOTHING ? NaN : value);
    [this.ttc, this.gap, this.delay] = ["ttc_s", "gap_m", "delay_s"].map((name) => column(name).map(orNone));
    this.owner = episode.counts(`${prefix}motion.owner`);
    this.lights = episode.counts(`${prefix}motion.lights`);
    this.mode = episode.counts(`${prefix}motion.mode`);
    let row = 0;
    this.actors.forEach((actor, index) => {
      this.indices.set(actor.id, index);
      this.firstRow.push(row);
      row += actor.frames;
    });
    this.rolled = new Float64Array(this.x.length);
    this.actors.forEach(({ frames }, index) => {
      const first = this.firstRow[index];
      for (let row = first + 1; row < first + frames; row++) {
        const [dx, dy, yaw] = [this.x[row] - this.x[row - 1], this.y[row] - this.y[row - 1], this.yaw[row]];
        this.rolled[row] = this.rolled[row - 1] + Math.cos(yaw) * dx + Math.sin(yaw) * dy;
      }
    });
    this.emvs = emvs.map((id) => this.indexOf(id)).filter((index) => index >= 0);
  }

  get end(): number {
    return this.times[this.times.length - 1];
  }

  /** Place of an actor in `actors`; -1 for an unknown one. */
  indexOf(id: number): number {
    return this.indices.get(id) ?? -1;
  }

  /** The last frame at or before a time. */
  frameAt(time: number): number {
    let low = 0;
    let high = this.times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= time + 1e-9) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** Sets the time that `pose` answers for; after the end nobody is there. */
  setTime(time: number): void {
    this.frame = time > this.end + 0.1 ? this.times.length : this.frameAt(time);
    const [before, after] = [this.times[this.frame], this.times[this.frame + 1] ?? Infinity];
    this.share = Math.min(Math.max((time - before) / (after - before), 0), 1);
  }

  /** Row of an actor in a frame; -1 where it is not there. */
  rowAt(index: number, frame: number): number {
    const local = frame - this.actors[index].first;
    if (local < 0 || local >= this.actors[index].frames) return -1;
    const row = this.firstRow[index] + local;
    return this.mode[row] === ABSENT ? -1 : row;
  }

  /** Colour of an actor's mode; undefined where there is nothing to show. */
  modeColour(index: number, row: number): string | undefined {
    const mode = this.episode.head.modes[this.mode[row]];
    return (this.actors[index].emv ? mode?.emv_colour : mode?.colour) || undefined;
  }

  /** Where an actor is at the time that was set; false where it is not there. */
  pose(index: number, pose: Pose): boolean {
    const row = this.rowAt(index, this.frame);
    if (row < 0) return false;
    const next = this.rowAt(index, this.frame + 1);
    const [after, share] = next < 0 ? [row, 0] : [next, this.share];
    pose.row = row;
    pose.x = this.x[row] + share * (this.x[after] - this.x[row]);
    pose.y = this.y[row] + share * (this.y[after] - this.y[row]);
    pose.z = this.z[row] + share * (this.z[after] - this.z[row]);
    pose.steer = this.steer[row] + share * (this.steer[after] - this.steer[row]);
    pose.rolled = this.rolled[row] + share * (this.rolled[after] - this.rolled[row]);
    const turn = this.yaw[after] - this.yaw[row];
    pose.yaw = this.yaw[row] + share * Math.atan2(Math.sin(turn), Math.cos(turn));
    return true;
  }

  /** Distance between the middles of an actor and the nearest EMV but itself in a frame; NaN without one. */
  distanceToEmv(index: number, frame: number): number {
    const row = this.rowAt(index, frame);
    let nearest = NaN;
    for (const emv of row < 0 ? [] : this.emvs) {
      const other = this.rowAt(emv, frame);
      if (emv === index || other < 0) continue;
      const distance = Math.hypot(this.x[row] - this.x[other], this.y[row] - this.y[other]);
      if (!(nearest <= distance)) nearest = distance;
    }
    return nearest;
  }
}
