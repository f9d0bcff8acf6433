/** What the page tells of the episode and of the selected actor. */

import { byId, element, say, words } from "./dom";
import { NOT_YET, type Actor, type Episode, type EpisodeEvent } from "./episode";
import type { Other } from "./other";
import { BEACON, BRAKE, INDICATOR_LEFT, INDICATOR_RIGHT, SIREN, type Pose, type Tracks } from "./tracks";
import { WhySection } from "./why_section";

const KMH = 3.6;
const LIGHTS: [number, string][] = [
  [BRAKE, "brake"],
  [INDICATOR_LEFT, "left indicator"],
  [INDICATOR_RIGHT, "right indicator"],
  [BEACON, "beacon"],
  [SIREN, "siren"],
];
/** Kinds of events whose names in bags say too little here. */
const KINDS: Record<string, string | undefined> = { owner_changed: "control passes" };
const ROWS = ["class", "mode", "speed", "acceleration", "decided by", "off SUMO's position", "to the EMV", "lights"];
const MOST_EVENTS = 400;

export interface Actions {
  select(id: number): void;
  seek(time: number): void;
  link(): string;
}

export class Panel {
  private readonly cells = new Map<string, HTMLElement>();
  private readonly swatch = swatch("");
  private readonly choice = byId<HTMLSelectElement>("actor");
  private readonly own = byId("own-events");
  private readonly ended = element("dd");
  private readonly why: WhySection;
  private ownEvents: { time: number; item: HTMLElement }[] = [];
  private latest: HTMLElement | undefined;
  private index = -1;

  constructor(
    private readonly episode: Episode,
    private readonly tracks: Tracks,
    private readonly others: Other[],
    private readonly actions: Actions,
  ) {
    const { head } = episode;
    this.why = new WhySection(episode, actions.select, (id) => this.shortName(id));
    this.choice.addEventListener("change", () => actions.select(Number(this.choice.value)));
    const list = byId("facts-of-actor");
    const inOthers = others.map((other) => [rowOf(other), other.colour] as const);
    for (const [row, colour] of [...ROWS.slice(0, -1).map((row) => [row, ""]), ...inOthers, ["lights", ""]]) {
      const cell = element("dd", colour ? { class: "elsewhere" } : {});
      this.cells.set(row, cell);
      list.append(element("dt", {}, ...(colour ? [swatch(`var(${colour})`)] : []), row), cell);
    }
    byId("others").hidden = others.length === 0;
    byId("other-list").append(...others.map((other) => this.entryOf(other)));
    byId("go-there").addEventListener("click", () => actions.seek(tracks.times[tracks.actors[this.index].first]));
    this.showEnd();
    byId("facts").append(...head.facts.flatMap(([name, text]) => [element("dt", {}, name), element("dd", {}, text)]));
    byId("facts").append(element("dt", {}, "ended"), this.ended);
    byId("command").textContent = head.command;
    const entry = (colour: string, name: string, code: string) =>
      element("li", {}, ...(colour ? [swatch(colour)] : []), `${name} `, element("code", {}, code));
    const coloured = head.modes.filter(({ colour }) => colour);
    const plain = head.modes.filter(({ colour, emv_colour }) => !colour && !emv_colour);
    byId("colours").append(
      ...head.modes.flatMap(({ emv_colour, name, code }) => (emv_colour ? [entry(emv_colour, `EMV: ${name}`, code)] : [])),
      ...[...coloured, ...plain].map(({ colour, name, code }) => entry(colour, name, code)),
    );
    copies(byId("copy-command"), () => head.command);
    copies(byId("copy-link"), () => actions.link());
    this.append(0, head.events);
  }

  /** Takes the tracks' actors from a place on, and events. */
  append(first: number, events: EpisodeEvent[]): void {
    for (const actor of this.tracks.actors.slice(first)) this.choice.add(new Option(nameOf(actor), String(actor.id)));
    const [list, marked] = [byId("all-events"), events.filter((event) => event[5])];
    list.append(...marked.slice(0, MOST_EVENTS - list.childElementCount).map((event) => this.item(event, true)));
    const own = this.tracks.actors[this.index]?.id;
    if (events.some((event) => event[2] === own || event[3] === own)) this.select(this.index);
  }

  /** Another episode, with the moment at which it first differs. */
  private entryOf({ label, colour, difference, near }: Other): HTMLElement {
    const entry = element("li", {}, swatch(`var(${colour})`), label);
    const text = !near ? "on another map" : difference ? "differs from the begin on" : "the same at all steps of both";
    if (!difference?.frame) entry.append(element("span", {}, text));
    else {
      const [time, { id }] = [this.tracks.times[difference.frame], this.tracks.actors[difference.index]];
      const press = () => {
        this.actions.seek(time);
        this.actions.select(id);
      };
      const text = `first differs at ${time.toFixed(2)} s: ${this.shortName(id)}`;
      entry.append(element("button", { type: "button", click: press }, text));
    }
    return entry;
  }

  /** How the episode ended, and its verdict. */
  showEnd(): void {
    const { verdict, ended } = this.episode.head;
    const badge = byId("verdict");
    say(this.ended, ended);
    badge.hidden = ended === NOT_YET;
    badge.textContent = !verdict ? "not judged" : verdict.holds ? "interaction verified" : "interaction not found";
    badge.className = !verdict ? "badge" : verdict.holds ? "badge good" : "badge bad";
    byId("verdict-text").textContent = verdict?.text ?? "";
    const parts = verdict?.parts ?? [];
    byId("verdict-parts").replaceChildren(
      ...parts.map(({ holds, text, at }) => {
        const said = `${holds ? "✓" : "✗"} ${text}`;
        const press = () => at && this.goTo(...at);
        return element(
          "li",
          { class: holds ? "good" : "bad" },
          at ? element("button", { type: "button", click: press }, said) : said,
        );
      }),
    );
    byId("verdict-details").hidden = parts.length === 0;
  }

  private item([step, kind, actor, other, details, colour]: EpisodeEvent, named: boolean): HTMLElement {
    const time = step * this.episode.head.step_s;
    const who = [named && this.shortName(actor), other && this.shortName(other)].filter(Boolean).join(" – ");
    const press = () => (named ? this.goTo(step, actor) : this.actions.seek(time));
    const dot = element("span", { class: "dot" });
    if (colour) dot.style.background = colour;
    const text = [KINDS[kind] ?? words(kind), who, details].filter(Boolean).join(" · ");
    const moment = element("span", { class: "moment" }, `${time.toFixed(2)} s`);
    return element("li", {}, element("button", { type: "button", click: press }, moment, dot, element("span", {}, text)));
  }

  private goTo(step: number, actor: number): void {
    this.actions.seek(step * this.episode.head.step_s);
    this.actions.select(actor);
  }

  private shortName(id: number): string {
    const index = this.tracks.indexOf(id);
    if (index < 0) return `#${id}`;
    return this.tracks.actors[index].emv ? `EMV ${id}` : `${words(this.tracks.actors[index].class)} ${id}`;
  }

  select(index: number): void {
    this.index = index;
    const actor = this.tracks.actors[index];
    this.choice.value = actor ? String(actor.id) : "";
    const mine = this.episode.head.events.filter((event) => actor && (event[2] === actor.id || event[3] === actor.id));
    this.ownEvents = mine.slice(0, MOST_EVENTS).map((event) => ({
      time: event[0] * this.episode.head.step_s,
      item: this.item(event, event[2] !== actor.id),
    }));
    this.own.replaceChildren(...this.ownEvents.map(({ item }) => item));
    byId("nothing-happened").hidden = mine.length > 0;
  }

  /** Shows the selected actor in a frame. */
  show(frame: number, pose: Pose | undefined): void {
    const { tracks, index } = this;
    const row = index < 0 ? -1 : tracks.rowAt(index, frame);
    const set = (name: string, text: string) => say(this.cells.get(name) as HTMLElement, row < 0 ? "–" : text);
    const actor = tracks.actors[index];
    byId("gone").hidden = row >= 0;
    set("speed", `${(tracks.speed[row] * KMH).toFixed(1)} km/h`);
    set("acceleration", `${signed(tracks.accel[row])} m/s²`);
    set("decided by", tracks.owner[row] === 1 ? "the behaviour model" : "SUMO");
    set("off SUMO's position", `${tracks.residual[row]?.toFixed(2)} m`);
    const distance = row < 0 ? NaN : tracks.distanceToEmv(index, frame);
    set("to the EMV", Number.isNaN(distance) ? "–" : `${distance.toFixed(1)} m`);
    set("lights", LIGHTS.filter(([bit]) => tracks.lights[row] & bit).map(([, name]) => name).join(", ") || "none");
    say(this.cells.get("class") as HTMLElement, actor ? `${words(actor.class)}${actor.emv ? " (EMV)" : ""}` : "–");
    const mode = this.cells.get("mode") as HTMLElement;
    const name = row < 0 ? "–" : (this.episode.head.modes[tracks.mode[row]]?.name ?? String(tracks.mode[row]));
    if (mode.textContent !== name) mode.replaceChildren(this.swatch, name);
    const modeColour = row < 0 ? undefined : tracks.modeColour(index, row);
    this.swatch.hidden = !modeColour;
    this.swatch.style.background = modeColour ?? "";
    for (const other of this.others) say(this.cells.get(rowOf(other)) as HTMLElement, other.description(index, pose));
    const time = tracks.times[frame];
    const latest = this.ownEvents.findLast((event) => event.time <= time + 1e-9);
    if (latest?.item !== this.latest) {
      this.latest?.classList.remove("latest");
      this.latest = latest?.item;
      this.latest?.classList.add("latest");
    }
    this.why.show(actor?.id ?? 0, time, tracks.owner[row] === 1 ? "none: it holds the brake" : "none: SUMO drives");
  }
}

function rowOf({ number }: Other): string {
  return `in ${number}`;
}

function swatch(colour: string): HTMLElement {
  const made = element("span", { class: "swatch" });
  made.style.background = colour;
  return made;
}

function signed(value: number | undefined): string {
  return value === undefined ? "" : `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(2)}`;
}

function nameOf(actor: Actor): string {
  return `${actor.id} · ${words(actor.class)}${actor.emv ? " (EMV)" : ""} · ${actor.name}`;
}

/** Makes a button copy a text; where the browser refuses, the text is shown to be copied by hand. */
function copies(button: HTMLElement, text: () => string): void {
  const label = button.textContent ?? "";
  button.addEventListener("click", () => {
    const done = () => {
      button.textContent = "Copied";
      setTimeout(() => (button.textContent = label), 1500);
    };
    (navigator.clipboard?.writeText(text()) ?? Promise.reject()).then(done, () => window.prompt(label, text()));
  });
}
