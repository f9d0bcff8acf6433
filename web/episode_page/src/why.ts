/** Why an actor drives as it does: its target speed, what limits it, and the guards that acted, where they are known. */

import type { Episode } from "./episode";

export interface Limit {
  mechanism: string;
  speed: number;
  /** Id of the actor because of which it limits; 0 for none. */
  blocker: number;
}

export interface Guard {
  name: string;
  acts: boolean;
  why: string;
}

export interface Reasons {
  /** Negative where there is none. */
  target: number;
  /** The lowest first. */
  limits: Limit[];
  guards: Guard[];
}

export class Why {
  private readonly rows = new Map<string, number>();
  private readonly target: Float64Array;
  private readonly limitEnds: Int32Array;
  private readonly guardEnds: Int32Array;
  private readonly mechanism: Int32Array;
  private readonly speed: Float64Array;
  private readonly blocker: Int32Array;
  private readonly guardName: Int32Array;
  private readonly guardActs: Int32Array;
  private readonly guardWhy: Int32Array;

  constructor(private readonly episode: Episode) {
    const steps = episode.counts("why.step");
    episode.counts("why.actor").forEach((actor, row) => this.rows.set(`${actor} ${steps[row]}`, row));
    this.target = episode.numbers("why.target_mps");
    this.limitEnds = ends(episode.counts("why.limits"));
    this.guardEnds = ends(episode.counts("why.guards"));
    this.mechanism = episode.counts("limit.mechanism");
    this.speed = episode.numbers("limit.speed_mps");
    this.blocker = episode.counts("limit.blocker");
    this.guardName = episode.counts("guard.name");
    this.guardActs = episode.counts("guard.acts");
    this.guardWhy = episode.counts("guard.why");
  }

  /** The reasons of an actor at a step; undefined where there are none. */
  of(actor: number, step: number): Reasons | undefined {
    const row = this.rows.get(`${actor} ${step}`);
    const names = this.episode.head.why;
    if (row === undefined || !names) return undefined;
    const limits: Limit[] = [];
    for (let i = this.limitEnds[row - 1] ?? 0; i < this.limitEnds[row]; i++) {
      limits.push({ mechanism: names.mechanisms[this.mechanism[i]], speed: this.speed[i], blocker: this.blocker[i] });
    }
    const guards: Guard[] = [];
    for (let i = this.guardEnds[row - 1] ?? 0; i < this.guardEnds[row]; i++) {
      const [name, why] = [names.texts[this.guardName[i]], names.texts[this.guardWhy[i]]];
      guards.push({ name, acts: this.guardActs[i] === 1, why });
    }
    return { target: this.target[row], limits: limits.sort((a, b) => a.speed - b.speed), guards };
  }
}

function ends(counts: Int32Array): Int32Array {
  let sum = 0;
  return counts.map((count) => (sum += count));
}
