/** What the page knows of an episode: the head as the exporter wrote it, and columns of numbers by name. */

export interface Actor {
  id: number;
  name: string;
  class: string;
  /** Length, width, height. */
  size_m: [number, number, number];
  rgb: number;
  emv: boolean;
  /** First frame in which the actor is there, and the number of frames up to its last one. */
  first: number;
  frames: number;
}

export interface Mode {
  name: string;
  /** What bags call it. */
  code: string;
  /** Colour of a civilian in this mode; empty where it is like any other. */
  colour: string;
  emv_colour: string;
}

/** A condition of the predicate, with step and actor of the moment that decides it. */
export interface JudgedPart {
  holds: boolean;
  text: string;
  at: [step: number, actor: number] | null;
}

/** Step, kind (`predicate.…`: a moment of that part), actor, other actor (0: none), details, colour of the mark (empty: no mark). */
export type EpisodeEvent = [step: number, kind: string, actor: number, other: number, details: string, colour: string];

/** Signal, link in its state, colour, number of corners of the lens. */
export type Lamp = [signal: string, link: number, colour: "red" | "yellow" | "green", corners: number];

/** One of the page's episodes. The names of its columns begin with `prefix`, those of its map's scene with `scene`. */
export interface Part {
  title: string;
  prefix: string;
  scene: string;
  actors: Actor[];
  emvs: number[];
  left_hand: boolean;
  signals: Record<string, [since: number, state: string][]>;
  /** Of its map; an episode on the map of the first has those of the first. */
  lamps?: Lamp[];
}

interface ColumnEntry {
  name: string;
  length: number;
  unit: number;
  order: number;
  /** Of one number; 4 where it is missing. */
  bytes?: number;
}

/** A sweep: its step, the number of its points, and the place in the map that they are counted from. */
export type SweepEntry = [step: number, count: number, x: number, y: number, z: number];

interface Head extends Part {
  format: number;
  step_s: number;
  begin_s: number;
  ended: string;
  verdict: { holds: boolean; text: string; parts: JudgedPart[] } | null;
  command: string;
  facts: [string, string][];
  modes: Mode[];
  events: EpisodeEvent[];
  lamp_letters: Record<string, string>;
  why?: { mechanisms: string[]; texts: string[] };
  /** What the page says where it has no `why`. */
  no_why: string;
  /** What its sensors measured; of a picture its step and the number of its bytes. */
  sensed?: {
    lidars: { name: string; sweeps: SweepEntry[] }[];
    cameras: { name: string; shots: [step: number, length: number][] }[];
  };
  /** The episodes that this one is compared with. */
  against: Part[];
  columns: ColumnEntry[];
}

const FORMAT = 3;
/** How an episode has ended that is under way. */
export const NOT_YET = "not yet";

export class Episode {
  private readonly offsets = new Map<string, [number, ColumnEntry]>();

  constructor(
    readonly head: Head,
    private readonly bytes: Uint8Array<ArrayBuffer>,
    start: number,
  ) {
    for (const entry of head.columns) {
      this.offsets.set(entry.name, [start, entry]);
      start += (entry.bytes ?? 4) * entry.length;
    }
  }

  /** A column as the whole numbers that it counts in. */
  counts(name: string): Int32Array {
    const [start, { length, order, bytes: width = 4 }] = this.offsets.get(name) ?? [0, { length: 0, order: 0 }];
    const bytes = this.bytes;
    const values = new Int32Array(length);
    for (let k = 0, at = start; k < width; k++) {
      for (let i = 0; i < length; i++, at++) values[i] |= bytes[at] << (8 * k);
    }
    const unused = 32 - 8 * width;
    for (let i = 0; i < length; i++) values[i] = (values[i] << unused) >> unused;
    for (let k = 0; k < order; k++) {
      for (let i = 1; i < length; i++) values[i] = ((values[i] + values[i - 1]) << unused) >> unused;
    }
    return values;
  }

  /** Bytes that were added as they are. */
  bytesOf(name: string): Uint8Array<ArrayBuffer> {
    const [start, { length }] = this.offsets.get(name) ?? [0, { length: 0 }];
    return this.bytes.subarray(start, start + length);
  }

  /** The lenses of the map of one of the episodes. */
  lampsOf({ scene }: Part): Lamp[] {
    return [this.head, ...this.head.against].find(({ prefix }) => prefix === scene)?.lamps ?? [];
  }

  /** Takes the signals, events and end of what is new of a running episode; its motion is for `Tracks.append`. */
  append({ head: { signals, events, ended, verdict } }: Episode): void {
    for (const [signal, changes] of Object.entries(signals)) {
      const before = (this.head.signals[signal] ??= []);
      before.push(...changes.filter(([, state], place) => place > 0 || before.at(-1)?.[1] !== state));
    }
    this.head.events.push(...events);
    if (ended) [this.head.ended, this.head.verdict] = [ended, verdict];
  }

  /** A column in its unit. */
  numbers(name: string): Float64Array {
    const unit = this.offsets.get(name)?.[1].unit ?? 1;
    return Float64Array.from(this.counts(name), (count) => count * unit);
  }
}

/** Reads what the exporter wrote: base64 of zlib of the length of the head, the head, and the columns. */
export async function readEpisode(text: string): Promise<Episode> {
  const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length))) as Head;
  if (head.format !== FORMAT) throw new Error(`data of format ${head.format}; this page reads format ${FORMAT}`);
  return new Episode(head, bytes, 4 + length);
}
