/** The time that is shown, and what plays, steps and scrubs through it. */

import { byId, say } from "./dom";

const RATES = [0.1, 0.25, 0.5, 1, 2, 4, 8];

export class Clock {
  time = 0;
  playing = false;
  private readonly scrub = byId<HTMLInputElement>("scrub");
  private readonly button = byId<HTMLButtonElement>("play");
  private readonly choice = byId<HTMLSelectElement>("rate");
  private readonly text = byId("clock");

  /** `end` is the last time that there is now. `moved` hears of each new time, `rested` of each at which the clock stays. */
  constructor(
    private readonly step_s: number,
    private readonly end: () => number,
    private readonly moved: () => void,
    private readonly rested: () => void,
  ) {
    this.scrub.step = String(step_s);
    this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
    for (const rate of RATES) this.choice.add(new Option(`${rate} ×`, String(rate), rate === 1, rate === 1));
  }

  /** Seconds of the episode in a second. */
  get rate(): number {
    return Number(this.choice.value);
  }

  seek(time: number): void {
    if (!Number.isFinite(time)) return;
    this.time = Math.min(Math.max(time, 0), this.end());
    this.moved();
  }

  play(playing: boolean): void {
    if (playing && this.time >= this.end() - 1e-6) this.seek(0);
    this.playing = playing;
    say(this.button, playing ? "❚❚" : "▶");
    this.button.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (!playing) this.rested();
  }

  /** Goes to the step before or after the present moment. */
  step(by: number): void {
    this.play(false);
    const steps = this.time / this.step_s;
    this.seek((by < 0 ? Math.ceil(steps - 1e-6) - 1 : Math.floor(steps + 1e-6) + 1) * this.step_s);
    this.rested();
  }

  faster(by: number): void {
    this.choice.selectedIndex = Math.min(Math.max(this.choice.selectedIndex + by, 0), RATES.length - 1);
  }

  /** Plays on; `passed` is the reader's time since the picture before. */
  tick(passed: number): void {
    if (!this.playing) return;
    this.seek(this.time + passed * this.rate);
    if (this.time >= this.end()) this.play(false);
  }

  /** Shows the time without words. */
  show(): void {
    this.scrub.value = String(this.time);
  }

  tell(): void {
    const [time, end] = [this.time.toFixed(2), this.end().toFixed(2)];
    this.scrub.max = String(this.end());
    this.scrub.value = String(this.time);
    this.scrub.setAttribute("aria-valuetext", `${time} seconds`);
    say(this.text, `${time} / ${end} s`);
  }
}
