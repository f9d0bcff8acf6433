/** The line of time: a chart of the selected actor, its modes, marks of events, and the place of the present moment. */

import { byId, say } from "./dom";
import type { Episode } from "./episode";
import type { Fleet } from "./fleet";
import type { Ghosts } from "./ghosts";
import type { Tracks } from "./tracks";

const KMH = 3.6;
const BAND_PX = 7;
const MARKS_PX = 16;

interface Metric {
  unit: string;
  digits: number;
  value(tracks: Tracks, row: number, index: number, frame: number): number;
}

export class Timeline {
  private readonly canvas = byId<HTMLCanvasElement>("chart");
  private readonly cursor = byId("cursor");
  private readonly reading = byId("reading");
  private readonly choice = byId<HTMLSelectElement>("metric");
  private readonly metrics: Record<string, Metric>;
  private index = -1;

  constructor(
    private readonly episode: Episode,
    private readonly tracks: Tracks,
    private readonly fleet: Fleet,
    private readonly ghosts: Ghosts | undefined,
    seek: (time: number) => void,
    changed: () => void,
  ) {
    this.metrics = {
      speed: { unit: "km/h", digits: 0, value: (tracks, row) => tracks.speed[row] * KMH },
      acceleration: { unit: "m/s²", digits: 1, value: (tracks, row) => tracks.accel[row] },
      "distance to the EMV": {
        unit: "m",
        digits: 0,
        value: (tracks, _, index, frame) => tracks.distanceToEmv(index, frame),
      },
      "gap of the EMV": { unit: "m", digits: 1, value: (tracks, row) => tracks.gap[row] },
      "time to collision of the EMV": { unit: "s", digits: 2, value: (tracks, row) => tracks.ttc[row] },
      "delay of the EMV": { unit: "s", digits: 1, value: (tracks, row) => tracks.delay[row] },
      residual: { unit: "m", digits: 2, value: (tracks, row) => tracks.residual[row] },
    };
    for (const name of Object.keys(this.metrics)) this.choice.add(new Option(name));
    this.choice.addEventListener("change", () => {
      this.draw();
      changed();
    });
    const move = (event: PointerEvent) => {
      const box = this.canvas.getBoundingClientRect();
      seek(Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1) * tracks.end);
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      move(event);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && move(event));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  select(index: number): void {
    this.index = index;
    this.draw();
  }

  /** Shows a moment. */
  show(time: number, frame: number): void {
    this.cursor.style.transform = `translateX(${((time / this.tracks.end) * this.canvas.clientWidth).toFixed(1)}px)`;
    const row = this.index < 0 ? -1 : this.tracks.rowAt(this.index, frame);
    const metric = this.metrics[this.choice.value];
    const value = row < 0 ? NaN : metric.value(this.tracks, row, this.index, frame);
    say(this.reading, Number.isNaN(value) ? "–" : `${value.toFixed(metric.digits)} ${metric.unit}`);
  }

  /** Draws everything but the present moment. */
  draw(): void {
    const { canvas, tracks } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    canvas.width = Math.round(width * devicePixelRatio);
    canvas.height = Math.round(height * devicePixelRatio);
    const context = canvas.getContext("2d");
    if (!context || width === 0) return;
    context.scale(devicePixelRatio, devicePixelRatio);
    const style = getComputedStyle(canvas);
    const colour = (name: string) => style.getPropertyValue(name);
    const x = (time: number) => (time / tracks.end) * width;
    context.font = `10px ${style.fontFamily}`;
    context.fillStyle = context.strokeStyle = colour("--line");
    const every = [0.5, 1, 2, 5, 10, 20, 60, 120].find((seconds) => x(seconds) > 46) ?? 300;
    for (let time = 0; time <= tracks.end; time += every) context.fillRect(x(time), 0, 1, height);
    this.drawMarks(context, x, colour("--faint"));
    if (this.index >= 0) this.drawActor(context, x, height, ["--ink", "--faint", "--page", "--link"].map(colour));
    context.fillStyle = colour("--faint");
    for (let time = 0; time <= tracks.end; time += every) context.fillText(`${time} s`, x(time) + 3, height - 2);
  }

  private drawMarks(context: CanvasRenderingContext2D, x: (time: number) => number, faint: string): void {
    const selected = this.tracks.actors[this.index]?.id;
    for (const [step, kind, actor, other, , colour] of this.episode.head.events) {
      if (!colour) continue;
      const mine = actor === selected || other === selected;
      const judged = kind.startsWith("predicate.");
      const at = x(step * this.episode.head.step_s);
      context.globalAlpha = mine || judged ? 1 : 0.55;
      context.fillStyle = colour;
      context.strokeStyle = faint;
      context.beginPath();
      const [middle, size] = [BAND_PX + MARKS_PX / 2, mine ? 5 : 3.5];
      if (judged) diamond(context, at, middle, 1.3 * size);
      else context.arc(at, middle, size, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  private drawActor(
    context: CanvasRenderingContext2D,
    x: (time: number) => number,
    height: number,
    [ink, faint, page, other]: string[],
  ): void {
    const { tracks, index, fleet } = this;
    const metric = this.metrics[this.choice.value];
    const { first, frames } = tracks.actors[index];
    for (let frame = first; frame < first + frames; frame++) {
      const row = tracks.rowAt(index, frame);
      const colour = row < 0 ? undefined : fleet.modeColour(index, row);
      if (!colour) continue;
      context.fillStyle = colour;
      const begin = x(tracks.times[frame]);
      context.fillRect(begin, 0, x(tracks.times[frame + 1] ?? tracks.end) - begin + 0.6, BAND_PX);
    }
    const lines = [valuesOf(tracks, index, metric)];
    const twin = this.ghosts?.twinOf(index) ?? -1;
    if (this.ghosts && twin >= 0) lines.unshift(valuesOf(this.ghosts.tracks, twin, metric));
    const known = lines.flat().map(([, value]) => value).filter((value) => !Number.isNaN(value));
    const low = known.reduce((least, value) => Math.min(least, value), 0);
    const high = Math.max(known.reduce((most, value) => Math.max(most, value), 0), low + 1e-3);
    const top = BAND_PX + MARKS_PX + 3;
    const y = (value: number) => top + (1 - (value - low) / (high - low)) * (height - 13 - top);
    context.strokeStyle = faint;
    context.lineWidth = 0.5;
    context.strokeRect(0, y(0), context.canvas.width, 0);
    context.lineWidth = 1.5;
    lines.forEach((line, place) => {
      const own = place === lines.length - 1;
      context.strokeStyle = own ? ink : other;
      context.setLineDash(own ? [] : [5, 3]);
      context.beginPath();
      let pen = false;
      for (const [time, value] of line) {
        if (Number.isNaN(value)) pen = false;
        else if (pen) context.lineTo(x(time), y(value));
        else {
          context.moveTo(x(time), y(value));
          pen = true;
        }
      }
      context.stroke();
    });
    context.setLineDash([]);
    context.fillStyle = faint;
    context.textAlign = "right";
    const most = `${high.toFixed(metric.digits)} ${metric.unit}`;
    context.strokeStyle = page;
    context.lineWidth = 4;
    context.strokeText(most, context.canvas.clientWidth - 4, top + 8);
    context.fillText(most, context.canvas.clientWidth - 4, top + 8);
    context.textAlign = "left";
  }
}

function diamond(context: CanvasRenderingContext2D, x: number, y: number, size: number): void {
  context.moveTo(x, y - size);
  context.lineTo(x + size, y);
  context.lineTo(x, y + size);
  context.lineTo(x - size, y);
  context.closePath();
}

/** An actor's times and values; no number where it is not there. */
function valuesOf(tracks: Tracks, index: number, metric: Metric): [time: number, value: number][] {
  const { first, frames } = tracks.actors[index];
  return Array.from({ length: frames }, (_, i) => {
    const row = tracks.rowAt(index, first + i);
    return [tracks.times[first + i], row < 0 ? NaN : metric.value(tracks, row, index, first + i)];
  });
}
