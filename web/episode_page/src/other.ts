/** Another episode on the same clock: which of its actors are those of this one, and how far they are apart. */

import type { Episode, Part } from "./episode";
import { newPose, Tracks, type Pose } from "./tracks";

const KMH = 3.6;
/** Columns count millimetres. */
const DIFFERENT_M = 0.0015;

export class Other {
  readonly tracks: Tracks;
  /** By the actors of the other episode and of this one: the actor of the same name in the one not asked; -1 for none. */
  readonly here: number[];
  readonly there: number[];
  /** Whether both are on one map, so that they can be drawn into one another. */
  readonly near: boolean;
  /** The frame and the actor of this episode with which they first differ while both last; undefined where they do not. */
  readonly difference: { frame: number; index: number } | undefined;
  private readonly pose = newPose();

  constructor(
    private readonly episode: Episode,
    readonly part: Part,
    private readonly main: Tracks,
    /** 2 for the first that is not the page's own. */
    readonly number: number,
  ) {
    this.tracks = new Tracks(episode, part);
    this.near = part.scene === episode.head.scene;
    const named = (tracks: Tracks) => new Map(tracks.actors.map(({ name }, index) => [name, index]));
    const [names, ownNames] = [named(this.tracks), named(main)];
    this.here = this.tracks.actors.map(({ name }) => ownNames.get(name) ?? -1);
    this.there = main.actors.map(({ name }) => names.get(name) ?? -1);
    this.difference = this.firstDifference();
  }

  get colour(): string {
    return `--other-${this.number}`;
  }

  get label(): string {
    return `${this.number} · ${this.part.title}`;
  }

  /** Between an actor of this episode in a frame and the one of its name at that time; no number where one is not there. */
  apart(index: number, frame: number): number {
    const twin = this.there[index];
    const [own, other] = [this.main.rowAt(index, frame), twin < 0 ? -1 : this.rowAt(twin, this.main.times[frame])];
    if (!this.near || own < 0 || other < 0) return NaN;
    return Math.hypot(this.main.x[own] - this.tracks.x[other], this.main.y[own] - this.tracks.y[other]);
  }

  /** Row of an actor of the other episode at a time of this one. */
  private rowAt(twin: number, time: number): number {
    return time > this.tracks.end + 1e-6 ? -1 : this.tracks.rowAt(twin, this.tracks.frameAt(time));
  }

  private firstDifference(): { frame: number; index: number } | undefined {
    const { times, actors } = this.main;
    for (let frame = 0; this.near && frame < times.length && times[frame] <= this.tracks.end + 1e-6; frame++) {
      const index = actors.findIndex((_, index) => {
        const twin = this.there[index];
        const there = twin >= 0 && this.rowAt(twin, times[frame]) >= 0;
        return there !== this.main.rowAt(index, frame) >= 0 || this.apart(index, frame) > DIFFERENT_M;
      });
      if (index >= 0) return { frame, index };
    }
    return undefined;
  }

  /** What the actor of the same name does at the time that both tracks have, as seen by an actor of this episode. */
  description(index: number, own: Pose | undefined): string {
    const { tracks, pose } = this;
    const twin = this.there[index] ?? -1;
    if (twin < 0 || !tracks.pose(twin, pose)) return "not there";
    const mode = this.episode.head.modes[tracks.mode[pose.row]]?.name ?? "";
    const does = `${(tracks.speed[pose.row] * KMH).toFixed(1)} km/h, ${mode}`;
    if (!own || !this.near) return does;
    const [dx, dy] = [pose.x - own.x, pose.y - own.y];
    const [c, s] = [Math.cos(own.yaw), Math.sin(own.yaw)];
    const apart = Math.hypot(dx, dy);
    return `${does}, ${apart < 0.05 ? "same place" : `${apart.toFixed(1)} m ${direction(c * dx + s * dy, c * dy - s * dx)}`}`;
  }
}

function direction(ahead: number, left: number): string {
  if (Math.abs(ahead) >= Math.abs(left)) return ahead > 0 ? "ahead" : "behind";
  return left > 0 ? "to the left" : "to the right";
}
