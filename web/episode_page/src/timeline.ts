/** The line of time: a chart of the selected actor, its modes, marks of events, and the place of the present moment. */

import { byId, say } from "./dom";
import type { Episode } from "./episode";
import type { Other } from "./other";
import type { Tracks } from "./tracks";

const KMH = 3.6;
const BAND_PX = 7;
const OTHER_BAND_PX = 4;
const MARKS_PX = 16;

const APART = "distance to the other episodes";

type Scale = (value: number) => number;
type Colours = (name: string) => string;
type Line = [time: number, value: number][];

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
  /** Of the chart; to ask for it again would lay out the page in each picture. */
  private width = 0;

  constructor(
    private readonly episode: Episode,
    private readonly tracks: Tracks,
    private readonly others: Other[],
    private readonly end: () => number,
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
      "distance from SUMO's position": { unit: "m", digits: 2, value: (tracks, row) => tracks.residual[row] },
    };
    if (others.some(({ near }) => near)) this.metrics[APART] = { unit: "m", digits: 1, value: () => NaN };
    for (const name of Object.keys(this.metrics)) this.choice.add(new Option(name));
    this.choice.addEventListener("change", () => {
      this.draw();
      changed();
    });
    const move = (event: PointerEvent) => {
      const box = this.canvas.getBoundingClientRect();
      seek(Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1) * end());
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

  /** Shows a moment without words. */
  show(time: number): void {
    this.cursor.style.transform = `translateX(${((time / this.end()) * this.width).toFixed(1)}px)`;
  }

  /** Reads the chart in a frame. */
  tell(frame: number): void {
    const row = this.index < 0 ? -1 : this.tracks.rowAt(this.index, frame);
    const metric = this.metrics[this.choice.value];
    const values =
      this.choice.value === APART
        ? this.others.map((other) => other.apart(this.index, frame))
        : [row < 0 ? NaN : metric.value(this.tracks, row, this.index, frame)];
    const known = values.filter((value) => !Number.isNaN(value)).map((value) => value.toFixed(metric.digits));
    say(this.reading, known.length > 0 ? `${known.join(" · ")} ${metric.unit}` : "–");
  }

  /** Draws everything but the present moment. */
  draw(): void {
    const { canvas } = this;
    const end = this.end();
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    this.width = width;
    canvas.width = Math.round(width * devicePixelRatio);
    canvas.height = Math.round(height * devicePixelRatio);
    const context = canvas.getContext("2d");
    if (!context || width === 0) return;
    context.scale(devicePixelRatio, devicePixelRatio);
    const style = getComputedStyle(canvas);
    const colour = (name: string) => style.getPropertyValue(name);
    const x = (time: number) => (time / end) * width;
    context.font = `10px ${style.fontFamily}`;
    context.fillStyle = context.strokeStyle = colour("--line");
    const every = [0.5, 1, 2, 5, 10, 20, 60, 120].find((seconds) => x(seconds) > 46) ?? 300;
    for (let time = 0; time <= end; time += every) context.fillRect(x(time), 0, 1, height);
    this.drawMarks(context, x, colour("--faint"));
    this.drawDifferences(context, x, height, colour);
    if (this.index >= 0) this.drawActor(context, x, height, colour);
    context.fillStyle = colour("--faint");
    for (let time = 0; time <= end; time += every) context.fillText(`${time} s`, x(time) + 3, height - 2);
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
      const [middle, size] = [this.bandsPx + MARKS_PX / 2, mine ? 5 : 3.5];
      if (judged) diamond(context, at, middle, 1.3 * size);
      else context.arc(at, middle, size, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  /** The moments at which the other episodes first differ. */
  private drawDifferences(context: CanvasRenderingContext2D, x: Scale, height: number, colour: Colours): void {
    for (const other of this.others) {
      if (!other.difference?.frame) continue;
      context.fillStyle = colour(other.colour);
      const at = x(this.tracks.times[other.difference.frame]);
      context.fillRect(at - 0.75, 0, 1.5, height);
      context.fillText(`≠ ${other.number}`, at + 3, height - 14);
    }
  }

  /** Height of the bands of modes. */
  private get bandsPx(): number {
    return BAND_PX + OTHER_BAND_PX * this.others.length;
  }

  private drawActor(context: CanvasRenderingContext2D, x: Scale, height: number, colour: Colours): void {
    const { tracks, index, others } = this;
    const metric = this.metrics[this.choice.value];
    drawModes(context, x, tracks, index, 0, BAND_PX);
    const lines: [colour: string, line: Line][] = [];
    others.forEach((other, place) => {
      const twin = other.there[index];
      if (twin < 0) return;
      drawModes(context, x, other.tracks, twin, BAND_PX + OTHER_BAND_PX * place, OTHER_BAND_PX);
      const apart = { ...metric, value: (...[, , , frame]: Parameters<Metric["value"]>) => other.apart(index, frame) };
      const line = this.choice.value === APART ? valuesOf(tracks, index, apart) : valuesOf(other.tracks, twin, metric);
      lines.push([other.colour, line]);
    });
    lines.push(["--ink", valuesOf(tracks, index, metric)]);
    const known = lines.flatMap(([, line]) => line.map(([, value]) => value)).filter((value) => !Number.isNaN(value));
    const low = known.reduce((least, value) => Math.min(least, value), 0);
    const high = Math.max(known.reduce((most, value) => Math.max(most, value), 0), low + 1e-3);
    const top = this.bandsPx + MARKS_PX + 3;
    const y = (value: number) => top + (1 - (value - low) / (high - low)) * (height - 13 - top);
    context.strokeStyle = context.fillStyle = colour("--faint");
    context.lineWidth = 0.5;
    context.strokeRect(0, y(0), context.canvas.width, 0);
    context.lineWidth = 1.5;
    for (const [name, line] of lines) {
      context.strokeStyle = colour(name);
      context.setLineDash(name === "--ink" ? [] : [5, 3]);
      context.stroke(pathOf(line, x, y));
    }
    context.setLineDash([]);
    context.textAlign = "right";
    const most = `${high.toFixed(metric.digits)} ${metric.unit}`;
    const wide = context.measureText(most).width + 8;
    context.fillStyle = colour("--page");
    context.globalAlpha = 0.75;
    context.fillRect(context.canvas.clientWidth - wide, top - 1, wide, 12);
    context.globalAlpha = 1;
    context.fillStyle = colour("--faint");
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

/** An actor's modes as a band of their colours. */
function drawModes(
  context: CanvasRenderingContext2D,
  x: Scale,
  tracks: Tracks,
  index: number,
  top: number,
  height: number,
): void {
  const { first, frames } = tracks.actors[index];
  for (let frame = first; frame < first + frames; frame++) {
    const row = tracks.rowAt(index, frame);
    const colour = row < 0 ? undefined : tracks.modeColour(index, row);
    if (!colour) continue;
    context.fillStyle = colour;
    const begin = x(tracks.times[frame]);
    context.fillRect(begin, top, x(tracks.times[frame + 1] ?? tracks.end) - begin + 0.6, height);
  }
}

/** A line with gaps where there is no number. */
function pathOf(line: Line, x: Scale, y: Scale): Path2D {
  const path = new Path2D();
  let pen = false;
  for (const [time, value] of line) {
    const known = !Number.isNaN(value);
    if (known && pen) path.lineTo(x(time), y(value));
    else if (known) path.moveTo(x(time), y(value));
    pen = known;
  }
  return path;
}

/** An actor's times and values; no number where it is not there. */
function valuesOf(tracks: Tracks, index: number, metric: Metric): Line {
  const { first, frames } = tracks.actors[index];
  return Array.from({ length: frames }, (_, i) => {
    const row = tracks.rowAt(index, first + i);
    return [tracks.times[first + i], row < 0 ? NaN : metric.value(tracks, row, index, first + i)];
  });
}
