/** The page: what is selected and shown, the loop that draws it, and the wiring of its parts. */

import { SRGBColorSpace, Vector3, WebGLRenderer } from "three";
import { CAMERAS, Cameras, type CameraName } from "./cameras";
import { Clock } from "./clock";
import { byId, say } from "./dom";
import type { Episode } from "./episode";
import { listenToKeys, type Keys } from "./keyboard";
import { Link, type Moment } from "./link";
import { Panel } from "./panel";
import { listenToClicks, placeInWindow, rayThrough } from "./picking";
import { Stage } from "./stage";
import { Timeline } from "./timeline";
import { Tracks } from "./tracks";

export class EpisodePage {
  private readonly canvas = byId<HTMLCanvasElement>("scene");
  private readonly renderer: WebGLRenderer;
  private readonly tracks: Tracks;
  private readonly stage: Stage;
  private readonly cameras: Cameras;
  private readonly clock: Clock;
  private readonly timeline: Timeline;
  private readonly panel: Panel;
  private readonly link: Link;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");
  private readonly dark = matchMedia("(prefers-color-scheme: dark)");
  private selected = -1;
  private changed = true;
  private before = 0;
  private readonly scriptMs: number[] = [];

  constructor(episode: Episode) {
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = SRGBColorSpace;
    const { actors, emvs, left_hand, step_s, begin_s } = episode.head;
    this.tracks = new Tracks(episode, actors, emvs);
    this.stage = new Stage(episode, this.tracks, byId("labels"));
    this.cameras = new Cameras(this.canvas, left_hand, !this.calm.matches);
    this.link = new Link(() => this.moment, (moment) => this.go(moment));
    const [seek, redraw] = [(time: number) => this.seek(time), () => this.redraw()];
    this.clock = new Clock(this.tracks, step_s, () => this.moved(), () => this.remember());
    this.timeline = new Timeline(episode, this.tracks, this.stage.fleet, this.stage.ghosts, seek, redraw);
    this.panel = new Panel(episode, this.tracks, { select: (id) => this.select(id), seek, link: () => this.link.address });
    this.prepareButtons(episode.head.against?.title ?? "");
    listenToKeys(this.keys());
    listenToClicks(this.canvas, (event) => this.click(event));
    this.cameras.controls.addEventListener("change", redraw);
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.dark.addEventListener("change", () => this.applyScheme());
    this.resize();
    this.applyScheme();
    this.seek(begin_s);
    this.select(emvs[0] ?? actors[0].id);
    this.useCamera("follow");
    this.link.apply();
    requestAnimationFrame((now) => this.nextPicture(now));
  }

  private prepareButtons(other: string): void {
    const press = (id: string, action: () => void) => byId(id).addEventListener("click", action);
    press("play", () => this.play(!this.clock.playing));
    press("back", () => this.clock.step(-1));
    press("ahead", () => this.clock.step(1));
    press("previous-actor", () => this.selectNext(-1));
    press("next-actor", () => this.selectNext(1));
    byId("against").hidden = !this.stage.ghosts;
    say(byId("against"), `against ${other}`);
    press("against", () => this.showOther(!this.stage.ghosts?.shown));
    for (const name of CAMERAS) press(`camera-${name}`, () => this.useCamera(name));
  }

  private keys(): Keys {
    const { clock } = this;
    const turn = (turn: number, nearer: number) => () => {
      this.cameras.move(turn, nearer);
      this.redraw();
    };
    const keys: Keys = {
      " ": () => this.play(!clock.playing),
      ArrowLeft: (shift) => (shift ? this.seek(clock.time - 1) : clock.step(-1)),
      ArrowRight: (shift) => (shift ? this.seek(clock.time + 1) : clock.step(1)),
      Home: () => this.seek(0),
      End: () => this.seek(this.tracks.end),
      n: () => this.selectNext(1),
      p: () => this.selectNext(-1),
      o: () => this.showOther(!this.stage.ghosts?.shown),
      a: turn(-0.1, 1),
      d: turn(0.1, 1),
      w: turn(0, 0.9),
      s: turn(0, 1 / 0.9),
      "+": () => clock.faster(1),
      "-": () => clock.faster(-1),
    };
    CAMERAS.forEach((name, place) => (keys[String(place + 1)] = () => this.useCamera(name)));
    return keys;
  }

  private resize(): void {
    const [width, height] = this.cameras.size;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.cameras.resize(width, height);
    this.redraw();
  }

  private applyScheme(): void {
    this.stage.world.setDark(this.dark.matches);
    this.timeline.draw();
    this.redraw();
  }

  private redraw(): void {
    this.changed = true;
  }

  private moved(): void {
    this.stage.seek(this.clock.time);
    this.redraw();
  }

  seek(time: number): void {
    this.clock.seek(time);
  }

  play(playing: boolean): void {
    this.clock.play(playing);
  }

  /** Selects an actor by its id; an unknown one changes nothing. */
  select(id: number): void {
    const index = this.tracks.indexOf(id);
    if (index < 0) return;
    this.selected = index;
    this.timeline.select(index);
    this.panel.select(index);
    this.redraw();
    this.remember();
  }

  /** The next actor that is there. */
  private selectNext(by: number): void {
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

  /** Shows or hides the other episode, where there is one. */
  showOther(shown: boolean): void {
    if (!this.stage.ghosts) return;
    this.stage.ghosts.shown = shown;
    byId("against").setAttribute("aria-pressed", String(shown));
    this.redraw();
  }

  private go({ time, actor, camera }: Moment): void {
    if (time !== undefined) this.seek(time);
    if (actor !== undefined) this.select(actor);
    if (camera !== undefined) this.useCamera(camera);
  }

  private remember(): void {
    if (!this.clock.playing && this.before > 0) this.link.remember();
  }

  private click(event: PointerEvent): void {
    const box = this.canvas.getBoundingClientRect();
    const index = this.stage.fleet.hit(rayThrough(event.clientX, event.clientY, box, this.cameras.camera));
    if (index >= 0) this.select(this.tracks.actors[index].id);
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
    const frame = clock.frame;
    stage.draw(this.renderer, this.cameras, selected, clock.rate, this.calm.matches);
    clock.show();
    this.timeline.show(clock.time, frame);
    const row = tracks.rowAt(selected, frame);
    const other = stage.ghosts?.description(selected, stage.fleet.poses[selected]) ?? "";
    this.panel.show(frame, row < 0 ? undefined : stage.fleet.modeColour(selected, row), other);
  }

  /** For programs that drive or check the page: the present moment. */
  get moment() {
    const actor = this.tracks.actors[this.selected]?.id ?? 0;
    return { time: this.clock.time, actor, camera: this.cameras.name, playing: this.clock.playing };
  }

  /** Poses as they were given to the graphics card for the present moment. */
  drawn() {
    this.draw();
    return this.stage.fleet.drawn();
  }

  /** The same of the other episode, where it differs. */
  drawnOther() {
    this.draw();
    return this.stage.ghosts?.drawn() ?? [];
  }

  /** Where an actor's middle is in the window, in pixels. */
  onScreen(id: number): [number, number] {
    const index = this.tracks.indexOf(id);
    const pose = this.stage.fleet.poses[index];
    if (!pose) return [NaN, NaN];
    const middle = new Vector3(pose.x, pose.y, pose.z + this.tracks.actors[index].size_m[2] / 2);
    return placeInWindow(middle, this.canvas.getBoundingClientRect(), this.cameras.camera);
  }

  /** Draw calls and triangles of the latest picture, and the script's times of the latest ones. */
  statistics() {
    const { calls, triangles } = this.renderer.info.render;
    return { calls, triangles, scriptMs: [...this.scriptMs] };
  }
}
