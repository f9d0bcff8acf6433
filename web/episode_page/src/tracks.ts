/** Where actors are at any time: between two frames on the straight line, with the shorter turn. */

import { NOT_YET, type Actor, type Episode, type Part } from "./episode";

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

/** Columns may have room for more rows than there are. */
export class Tracks {
  /** Time of each frame, in seconds. */
  times: Float64Array = new Float64Array();
  speed: Float64Array = new Float64Array();
  accel: Float64Array = new Float64Array();
  residual: Float64Array = new Float64Array();
  /** Of EMVs: least time to collision and least gap to another actor; no number where there is none. */
  ttc: Float64Array = new Float64Array();
  gap: Float64Array = new Float64Array();
  /** Of EMVs: the time lost against free flow since the begin; no number while an episode runs. */
  delay: Float64Array = new Float64Array();
  owner: Int32Array = new Int32Array();
  lights: Int32Array = new Int32Array();
  mode: Int32Array = new Int32Array();
  x: Float64Array = new Float64Array();
  y: Float64Array = new Float64Array();
  private z: Float64Array = new Float64Array();
  private yaw: Float64Array = new Float64Array();
  private steer: Float64Array = new Float64Array();
  private rolled: Float64Array = new Float64Array();
  private count = 0;
  /** Of each actor, from its first frame on: its row, -1 where it is not there. */
  private readonly rows: number[][] = [];
  private readonly indices = new Map<number, number>();
  /** Places in `actors`. */
  emvs: number[] = [];
  private frame = 0;
  private share = 0;

  readonly actors: Actor[] = [];

  constructor(private readonly episode: Episode, private readonly part: Part) {
    this.append(episode, part.actors);
  }

  /** Takes frames that follow those that are there; the actors' first frames count from the first of these. */
  append(more: Episode, actors: Actor[]): void {
    const [prefix, begin] = [this.part.prefix, this.times.length];
    const column = (name: string) => more.numbers(`${prefix}motion.${name}`);
    const orNone = (value: number) => (value >= NOTHING ? NaN : value);
    const steps = more.numbers(`${prefix}frame.step`);
    this.times = joined(this.times, steps.map((step) => step * this.episode.head.step_s));
    this.x = extended(this.x, this.count, column("x_m"));
    this.y = extended(this.y, this.count, column("y_m"));
    this.z = extended(this.z, this.count, column("z_m"));
    this.yaw = extended(this.yaw, this.count, column("yaw_rad"));
    this.steer = extended(this.steer, this.count, column("steer_rad"));
    this.speed = extended(this.speed, this.count, column("speed_mps"));
    this.accel = extended(this.accel, this.count, column("accel_mps2"));
    this.residual = extended(this.residual, this.count, column("residual_m"));
    this.ttc = extended(this.ttc, this.count, column("ttc_s").map(orNone));
    this.gap = extended(this.gap, this.count, column("gap_m").map(orNone));
    const delay = column("delay_s").map(this.episode.head.ended === NOT_YET ? () => NaN : orNone);
    this.delay = extended(this.delay, this.count, delay);
    this.owner = extended(this.owner, this.count, more.counts(`${prefix}motion.owner`));
    this.lights = extended(this.lights, this.count, more.counts(`${prefix}motion.lights`));
    this.mode = extended(this.mode, this.count, more.counts(`${prefix}motion.mode`));
    this.rolled = extended(this.rolled, this.count, new Float64Array(more.counts(`${prefix}motion.mode`).length));
    for (const actor of actors) this.admit(actor, begin + actor.first);
    this.emvs = this.part.emvs.map((id) => this.indexOf(id)).filter((index) => index >= 0);
  }

  /** Gives an actor the next rows, from a frame on. */
  private admit(actor: Actor, first: number): void {
    let index = this.indexOf(actor.id);
    if (index < 0) {
      index = this.actors.push({ ...actor, first, frames: 0 }) - 1;
      this.indices.set(actor.id, index);
      this.rows.push([]);
    }
    const [known, rows] = [this.actors[index], this.rows[index]];
    while (known.first + rows.length < first) rows.push(-1);
    let before = rows.at(-1) ?? -1;
    for (let frame = 0; frame < actor.frames; frame++) {
      const row = this.count++;
      if (before >= 0) this.roll(before, row);
      rows.push((before = row));
    }
    known.frames = rows.length;
  }

  private roll(before: number, row: number): void {
    const [dx, dy, yaw] = [this.x[row] - this.x[before], this.y[row] - this.y[before], this.yaw[row]];
    this.rolled[row] = this.rolled[before] + Math.cos(yaw) * dx + Math.sin(yaw) * dy;
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
    const row = this.rows[index][local];
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

function joined(before: Float64Array, added: Float64Array): Float64Array {
  const all = new Float64Array(before.length + added.length);
  all.set(before);
  all.set(added, before.length);
  return all;
}

/** The first `count` values and those that are added, in a column that is replaced where it is full. */
function extended<T extends Float64Array | Int32Array>(column: T, count: number, added: T): T {
  if (count === 0) return added;
  const most = count + added.length;
  let held = column;
  if (most > column.length) {
    held = new (column.constructor as new (length: number) => T)(2 * most);
    held.set(column.subarray(0, count));
  }
  held.set(added, count);
  return held;
}
