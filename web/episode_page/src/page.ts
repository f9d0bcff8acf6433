/** The page: what is selected and shown, the loop that draws it, and the wiring of its parts. */

import { Vector3 } from "three";
import { CAMERAS, Cameras, newCamera, type CameraName } from "./cameras";
import { Clock } from "./clock";
import { bindControls } from "./controls";
import { byId } from "./dom";
import type { Episode } from "./episode";
import { Ghosts } from "./ghosts";
import { Link, type Moment } from "./link";
import { Other } from "./other";
import { Panel } from "./panel";
import { listenToClicks, placeInWindow, rayThrough } from "./picking";
import { Sensors, type SensorKind } from "./sensors";
import { Stage } from "./stage";
import { Timeline } from "./timeline";
import { Tracks } from "./tracks";
import { Views } from "./views";

/** Texts that change faster than this cannot be read, and cost time. */
const TEXTS_MS = 100;
/** A moment that is shown for so long goes into the address; browsers refuse more than a few changes a second. */
const SETTLED_MS = 300;

export class EpisodePage {
  private readonly canvas = byId<HTMLCanvasElement>("scene");
  private readonly tracks: Tracks;
  private readonly others: Other[];
  private readonly stage: Stage;
  /** Those of the other episodes, which are made when they are first shown. */
  private readonly sides: Stage[] = [];
  private readonly views: Views;
  private readonly cameras: Cameras;
  readonly clock: Clock;
  private readonly timeline: Timeline;
  private readonly panel: Panel;
  private readonly link: Link;
  private readonly sensors: Sensors;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");
  private readonly dark = matchMedia("(prefers-color-scheme: dark)");
  private selected = -1;
  private changed = true;
  private before = 0;
  private told = 0;
  private settling = 0;
  private readonly scriptMs: number[] = [];

  /** `live` says whether more comes by `append`. */
  constructor(private readonly episode: Episode, live = false) {
    const { head } = episode;
    this.tracks = new Tracks(episode, head);
    this.others = head.against.map((part, place) => new Other(episode, part, this.tracks, place + 2));
    this.cameras = new Cameras(this.canvas, head.left_hand, !this.calm.matches);
    this.stage = new Stage(episode, head, this.tracks, this.cameras.camera, this.cameras.controls.target);
    for (const other of this.others) if (other.near) this.stage.ghosts.push(new Ghosts(other, this.stage.scene));
    this.views = new Views(this.canvas, this.cameras);
    this.link = new Link(() => this.moment, (moment) => this.go(moment));
    const [seek, redraw] = [(time: number) => this.seek(time), () => this.redraw()];
    this.clock = new Clock(head.step_s, () => this.end, () => this.moved(), () => this.rested());
    this.timeline = new Timeline(episode, this.tracks, this.others, () => this.end, seek, redraw);
    const actions = { select: (id: number) => this.select(id), seek, link: () => this.link.address };
    this.panel = new Panel(episode, this.tracks, this.others, actions);
    this.sensors = new Sensors(episode, this.stage.scene, redraw);
    byId("overlay").hidden = this.stage.ghosts.length === 0;
    byId("side").hidden = this.others.length === 0;
    bindControls(this);
    listenToClicks(this.canvas, (event) => this.click(event));
    this.cameras.controls.addEventListener("change", redraw);
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.dark.addEventListener("change", () => this.applyScheme());
    this.showBeside(this.others.length > this.stage.ghosts.length);
    this.applyScheme();
    this.seek(head.begin_s);
    this.select(head.emvs[0] ?? head.actors[0].id);
    this.useCamera("follow");
    this.clock.live = live;
    if (live) this.clock.follow();
    this.link.apply();
    requestAnimationFrame((now) => this.nextPicture(now));
  }

  /** The last time of all episodes. */
  get end(): number {
    return Math.max(this.tracks.end, ...this.others.map(({ tracks }) => tracks.end));
  }

  private resize(): void {
    this.views.layOut();
    this.redraw();
  }

  private applyScheme(): void {
    for (const { world } of [this.stage, ...this.sides]) world.setDark(this.dark.matches);
    this.timeline.draw();
    this.redraw();
  }

  private redraw(): void {
    this.changed = true;
  }

  private moved(): void {
    for (const { tracks } of this.others) tracks.setTime(this.clock.time);
    for (const stage of this.views.shown) stage.seek(this.clock.time);
    clearTimeout(this.settling);
    if (this.before > 0 && !this.clock.playing) this.settling = setTimeout(() => this.remember(), SETTLED_MS);
    this.redraw();
  }

  private rested(): void {
    this.remember();
    this.redraw();
  }

  seek(time: number): void {
    this.clock.seek(time);
  }

  play(playing: boolean): void {
    this.clock.play(playing);
  }

  /** Takes what is new of a running episode. */
  append(more: Episode): void {
    const known = this.tracks.actors.length;
    this.episode.append(more);
    this.tracks.append(more, more.head.actors);
    if (this.tracks.actors.length > known) this.stage.admit();
    this.panel.append(known, more.head.events);
    if (more.head.ended) {
      this.clock.live = false;
      this.panel.showEnd();
    }
    this.timeline.draw();
    this.redraw();
  }

  /** Whether more is to come. */
  get live(): boolean {
    return this.clock.live;
  }

  /** Whether it stays with the end of a running episode. */
  get following(): boolean {
    return this.clock.following;
  }

  get atEnd(): boolean {
    return this.clock.atEnd;
  }

  /** Goes to the end of a running episode and stays there. */
  follow(): void {
    this.clock.follow();
  }

  /** Selects an actor by its id; an unknown one changes nothing. */
  select(id: number): void {
    const index = this.tracks.indexOf(id);
    if (index < 0) return;
    this.selected = index;
    this.sides.forEach((stage, place) => (stage.wanted = this.others[place].there[index]));
    this.timeline.select(index);
    this.panel.select(index);
    this.redraw();
    this.remember();
  }

  /** The next actor that is there. */
  selectNext(by: number): void {
    const count = this.tracks.actors.length;
    for (let k = 1; k <= count; k++) {
      const index = (this.selected + by * k + count * k) % count;
      if (this.stage.fleet.poses[index]) return this.select(this.tracks.actors[index].id);
    }
  }

  useCamera(name: CameraName): void {
    this.cameras.use(name, this.stage.fleet.poses[this.selected]);
    for (const each of CAMERAS) byId(`camera-${each}`).setAttribute("aria-pressed", String(each === name));
    this.redraw();
    this.remember();
  }

  moveCamera(turn: number, nearer: number): void {
    this.cameras.move(turn, nearer);
    this.redraw();
  }

  toggleSensor(kind: SensorKind): void {
    this.sensors.toggle(kind);
  }

  /** Whether the other episodes' bodies are shown. */
  get overlaid(): boolean {
    return this.stage.ghosts[0]?.shown ?? false;
  }

  /** Shows or hides the bodies of the other episodes on this map. */
  showOthers(shown: boolean): void {
    for (const ghosts of this.stage.ghosts) ghosts.shown = shown;
    byId("overlay").setAttribute("aria-pressed", String(shown));
    this.redraw();
  }

  private get beside(): boolean {
    return this.views.shown.length > 1;
  }

  /** Shows all episodes beside each other, or this one alone. */
  showBeside(shown: boolean): void {
    if (shown && this.sides.length === 0) {
      for (const { part, tracks, label, there } of this.others) {
        const stage = new Stage(this.episode, part, tracks, newCamera(), new Vector3(), label);
        stage.world.setDark(this.dark.matches);
        stage.wanted = there[this.selected] ?? -1;
        this.sides.push(stage);
      }
    }
    this.views.show([this.stage, ...(shown ? this.sides : [])]);
    byId("side").setAttribute("aria-pressed", String(shown));
    this.moved();
    this.remember();
  }

  private go({ time, actor, camera, beside }: Moment): void {
    if (beside !== undefined) this.showBeside(beside);
    if (time !== undefined) this.seek(time);
    if (actor !== undefined) this.select(actor);
    if (camera !== undefined) this.useCamera(camera);
  }

  private remember(): void {
    if (!this.clock.playing && this.before > 0) this.link.remember();
  }

  private click(event: PointerEvent): void {
    const stage = this.views.at(event.clientX, event.clientY);
    const index = stage?.fleet.hit(rayThrough(event.clientX, event.clientY, this.views.boxOf(stage), stage.camera)) ?? -1;
    if (!stage || index < 0) return;
    const own = stage === this.stage ? index : this.others[this.sides.indexOf(stage)].here[index];
    if (own >= 0) this.select(this.tracks.actors[own].id);
    else stage.wanted = index;
    this.redraw();
  }

  private nextPicture(now: number): void {
    requestAnimationFrame((later) => this.nextPicture(later));
    const began = performance.now();
    this.clock.tick(Math.min((now - this.before) / 1000, 0.25));
    this.before = now;
    const { selected, tracks, stage } = this;
    const moving = this.cameras.update(selected, tracks.actors[selected], stage.fleet.poses[selected]);
    if (!(this.clock.playing || moving || this.changed)) return;
    this.changed = false;
    this.draw();
    this.scriptMs.push(performance.now() - began);
    if (this.scriptMs.length > 600) this.scriptMs.shift();
  }

  private draw(): void {
    const { clock, stage, selected, tracks } = this;
    const frame = tracks.frameAt(clock.time);
    this.sensors.show(clock.time);
    this.views.draw(selected, clock.rate, this.calm.matches);
    clock.show();
    this.timeline.show(clock.time);
    const now = performance.now();
    if (clock.playing && now - this.told < TEXTS_MS) return;
    this.told = now;
    clock.tell();
    this.timeline.tell(frame);
    this.panel.show(frame, stage.fleet.poses[selected]);
  }

  /** For programs that drive or check the page: the present moment. */
  get moment() {
    const actor = this.tracks.actors[this.selected]?.id ?? 0;
    const { time, playing } = this.clock;
    return { time, actor, camera: this.cameras.name, playing, beside: this.beside };
  }

  /** Poses as they were given to the graphics card for the present moment, in the first or another picture. */
  drawn(picture = 0) {
    this.draw();
    return this.views.shown[picture].fleet.drawn();
  }

  /** Bodies of the other episodes, where they differ. */
  drawnOthers() {
    this.draw();
    return this.stage.ghosts.map((ghosts) => ghosts.drawn());
  }

  /** Places of the LiDAR points of the present moment. */
  drawnPoints() {
    this.draw();
    return this.sensors.drawn();
  }

  /** Where the middle of a picture's actor is in the window, in pixels. */
  onScreen(id: number, picture = 0): [number, number] {
    const stage = this.views.shown[picture];
    const index = stage.tracks.indexOf(id);
    const pose = stage.fleet.poses[index];
    if (!pose) return [NaN, NaN];
    const middle = new Vector3(pose.x, pose.y, pose.z + stage.tracks.actors[index].size_m[2] / 2);
    return placeInWindow(middle, this.views.boxOf(stage), stage.camera);
  }

  /** Draw calls and triangles of the latest picture, and the script's times of the latest ones. */
  statistics() {
    return { ...this.views.counts, scriptMs: [...this.scriptMs] };
  }
}
