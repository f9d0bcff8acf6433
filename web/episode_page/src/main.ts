/** The page: its state, the loop that draws it, and what mouse, touch and keyboard do. */

import { Raycaster, Scene, SRGBColorSpace, Vector2, Vector3, WebGLRenderer } from "three";
import { CAMERAS, Cameras, type CameraName } from "./cameras";
import { byId, element, say, words } from "./dom";
import { readEpisode, type Episode } from "./episode";
import { Fleet } from "./fleet";
import { Ghosts } from "./ghosts";
import { Glows } from "./glows";
import { readMoment, writeMoment } from "./link";
import { Panel } from "./panel";
import { Timeline } from "./timeline";
import { Tracks } from "./tracks";
import { World } from "./world";

const RATES = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const CLICK_PX = 6;
/** In the reader's time where it runs faster: more than three a second are harmful. */
const FLASHES_HZ = { indicator: 1.5, beacon: 2 };
const KMH = 3.6;
/** From above, names stand this much higher than the middle of the vehicle, so that it is seen. */
const ABOVE_PX = 38;

class EpisodePage {
  private readonly canvas = byId<HTMLCanvasElement>("scene");
  private readonly scrub = byId<HTMLInputElement>("scrub");
  private readonly playButton = byId<HTMLButtonElement>("play");
  private readonly rate = byId<HTMLSelectElement>("rate");
  private readonly labels = byId("labels");
  private readonly tags = new Map<number, HTMLElement>();
  private readonly scene = new Scene();
  private readonly renderer: WebGLRenderer;
  private readonly tracks: Tracks;
  private readonly fleet: Fleet;
  private readonly world: World;
  private readonly glows: Glows;
  private readonly ghosts: Ghosts | undefined;
  private readonly cameras: Cameras;
  private readonly timeline: Timeline;
  private readonly panel: Panel;
  private readonly calm = matchMedia("(prefers-reduced-motion: reduce)");
  private readonly dark = matchMedia("(prefers-color-scheme: dark)");
  private time = 0;
  private selected = -1;
  private playing = false;
  private changed = true;
  private before = 0;
  private ownHash = "";
  private readonly scriptMs: number[] = [];

  constructor(private readonly episode: Episode) {
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = SRGBColorSpace;
    const { actors, emvs, against } = episode.head;
    this.tracks = new Tracks(episode, actors, emvs);
    this.world = new World(episode, this.scene);
    this.fleet = new Fleet(episode, this.tracks, this.scene);
    this.ghosts = against && new Ghosts(episode, against, this.tracks, this.scene);
    this.glows = new Glows(this.tracks, episode.head.lamps.length, this.scene);
    this.cameras = new Cameras(this.canvas, episode.head.left_hand, !this.calm.matches);
    const [seek, changed] = [(time: number) => this.seek(time), () => void (this.changed = true)];
    this.timeline = new Timeline(episode, this.tracks, this.fleet, this.ghosts, seek, changed);
    this.panel = new Panel(episode, this.tracks, {
      select: (id) => this.select(id),
      seek: (time) => this.seek(time),
      link: () => location.href.split("#")[0] + this.hash(),
    });
    this.prepareControls();
    this.resize();
    this.applyScheme();
    this.seek(episode.head.begin_s);
    this.select(episode.head.emvs[0] ?? this.tracks.actors[0].id);
    this.useCamera("follow");
    this.applyHash();
    requestAnimationFrame((now) => this.frame(now));
  }

  private prepareControls(): void {
    this.scrub.max = String(this.tracks.end);
    this.scrub.step = String(this.episode.head.step_s);
    this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
    for (const rate of RATES) this.rate.add(new Option(`${rate} ×`, String(rate), rate === 1, rate === 1));
    const press = (id: string, action: () => void) => byId(id).addEventListener("click", action);
    press("play", () => this.play(!this.playing));
    press("back", () => this.step(-1));
    press("ahead", () => this.step(1));
    press("previous-actor", () => this.selectNext(-1));
    press("next-actor", () => this.selectNext(1));
    byId("against").hidden = !this.ghosts;
    say(byId("against"), `against ${this.episode.head.against?.title ?? ""}`);
    press("against", () => this.showOther(!this.ghosts?.shown));
    for (const name of CAMERAS) press(`camera-${name}`, () => this.useCamera(name));
    this.cameras.controls.addEventListener("change", () => (this.changed = true));
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.dark.addEventListener("change", () => this.applyScheme());
    addEventListener("hashchange", () => location.hash !== this.ownHash && this.applyHash());
    addEventListener("keydown", (event) => this.press(event));
    let down = new Vector2();
    this.canvas.addEventListener("pointerdown", (event) => (down = new Vector2(event.clientX, event.clientY)));
    this.canvas.addEventListener("pointerup", (event) => {
      if (down.distanceTo(new Vector2(event.clientX, event.clientY)) < CLICK_PX) this.click(event);
    });
  }

  private resize(): void {
    const [width, height] = this.cameras.size;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.cameras.resize(width, height);
    this.changed = true;
  }

  private applyScheme(): void {
    this.world.setDark(this.dark.matches);
    this.timeline.draw();
    this.changed = true;
  }

  seek(time: number): void {
    if (!Number.isFinite(time)) return;
    this.time = Math.min(Math.max(time, 0), this.tracks.end);
    this.tracks.setTime(this.time);
    this.fleet.locate();
    this.scrub.value = String(this.time);
    this.scrub.setAttribute("aria-valuetext", `${this.time.toFixed(2)} seconds`);
    this.changed = true;
  }

  /** Selects an actor by its id; an unknown one changes nothing. */
  select(id: number): void {
    const index = this.tracks.indexOf(id);
    if (index < 0) return;
    this.selected = index;
    this.timeline.select(index);
    this.panel.select(index);
    this.changed = true;
    this.remember();
  }

  /** The next actor that is there. */
  private selectNext(by: number): void {
    const count = this.tracks.actors.length;
    for (let k = 1; k <= count; k++) {
      const index = (this.selected + by * k + count * k) % count;
      if (this.fleet.poses[index]) return this.select(this.tracks.actors[index].id);
    }
  }

  useCamera(name: CameraName): void {
    this.cameras.use(name, this.fleet.poses[this.selected]);
    for (const each of CAMERAS) byId(`camera-${each}`).setAttribute("aria-pressed", String(each === name));
    this.changed = true;
    this.remember();
  }

  /** Shows or hides the other episode, where there is one. */
  showOther(shown: boolean): void {
    if (!this.ghosts) return;
    this.ghosts.shown = shown;
    byId("against").setAttribute("aria-pressed", String(shown));
    this.changed = true;
  }

  play(playing: boolean): void {
    if (playing && this.time >= this.tracks.end - 1e-6) this.seek(0);
    this.playing = playing;
    say(this.playButton, playing ? "❚❚" : "▶");
    this.playButton.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (!playing) this.remember();
  }

  /** Goes to a frame before or after the present one. */
  private step(by: number): void {
    this.play(false);
    const frame = this.tracks.frameAt(this.time);
    const between = by < 0 && this.time - this.tracks.times[frame] > 1e-6;
    this.seek(this.tracks.times[frame + (between ? 0 : by)] ?? (by < 0 ? 0 : this.tracks.end));
    this.remember();
  }

  private hash(): string {
    return writeMoment(this.time, this.tracks.actors[this.selected]?.id ?? 0, this.cameras.name);
  }

  /** Puts the moment into the address, without an entry in the history. */
  private remember(): void {
    if (this.playing || this.before === 0) return;
    this.ownHash = this.hash();
    location.replace(this.ownHash);
  }

  private applyHash(): void {
    const { time, actor, camera } = readMoment(location.hash);
    if (time !== undefined) this.seek(time);
    if (actor !== undefined) this.select(actor);
    if (camera !== undefined) this.useCamera(camera);
  }

  private press(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.altKey || event.metaKey || target.tagName === "SELECT") return;
    if (target.tagName === "BUTTON" && event.key === " ") return;
    if (target === this.scrub && event.key.startsWith("Arrow")) return;
    const second = event.shiftKey ? 1 : 0;
    const faster = (by: number) => {
      this.rate.selectedIndex = Math.min(Math.max(this.rate.selectedIndex + by, 0), RATES.length - 1);
    };
    const actions: Record<string, () => void> = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => (second ? this.seek(this.time - 1) : this.step(-1)),
      ArrowRight: () => (second ? this.seek(this.time + 1) : this.step(1)),
      Home: () => this.seek(0),
      End: () => this.seek(this.tracks.end),
      n: () => this.selectNext(1),
      p: () => this.selectNext(-1),
      o: () => this.showOther(!this.ghosts?.shown),
      a: () => this.cameras.move(-0.1, 1),
      d: () => this.cameras.move(0.1, 1),
      w: () => this.cameras.move(0, 0.9),
      s: () => this.cameras.move(0, 1 / 0.9),
      "+": () => faster(1),
      "-": () => faster(-1),
    };
    CAMERAS.forEach((name, place) => (actions[String(place + 1)] = () => this.useCamera(name)));
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
    this.changed = true;
  }

  private click(event: PointerEvent): void {
    const box = this.canvas.getBoundingClientRect();
    const place = new Vector2(
      (2 * (event.clientX - box.left)) / box.width - 1,
      1 - (2 * (event.clientY - box.top)) / box.height,
    );
    const caster = new Raycaster();
    caster.setFromCamera(place, this.cameras.camera);
    const index = this.fleet.hit(caster.ray);
    if (index >= 0) this.select(this.tracks.actors[index].id);
  }

  private frame(now: number): void {
    requestAnimationFrame((later) => this.frame(later));
    const began = performance.now();
    const passed = Math.min((now - this.before) / 1000, 0.25);
    this.before = now;
    if (this.playing) {
      this.seek(this.time + passed * Number(this.rate.value));
      if (this.time >= this.tracks.end) this.play(false);
    }
    const actor = this.tracks.actors[this.selected];
    const moving = this.cameras.update(this.selected, actor, this.fleet.poses[this.selected]);
    if (!(this.playing || moving || this.changed)) return;
    this.changed = false;
    this.draw();
    this.scriptMs.push(performance.now() - began);
    if (this.scriptMs.length > 600) this.scriptMs.shift();
  }

  private draw(): void {
    const { camera, name } = this.cameras;
    const frame = this.tracks.frameAt(this.time);
    const slower = Math.max(Number(this.rate.value), 1);
    const phase = (hertz: number) => (this.calm.matches || ((this.time * hertz) / slower) % 1 < 0.5 ? 1 : 0);
    this.fleet.indicator.value = phase(FLASHES_HZ.indicator);
    this.fleet.beacon.value = this.calm.matches ? 0.6 : phase(FLASHES_HZ.beacon);
    this.world.setFrame(frame);
    this.world.setView(camera, this.cameras.controls.target, this.cameras.distance);
    const hidden = name === "driver" ? this.selected : -1;
    this.fleet.place(camera.position, this.selected, hidden);
    this.ghosts?.place(this.time, this.fleet.poses);
    const [indicator, beacon] = [this.fleet.indicator.value, this.fleet.beacon.value];
    this.glows.place(this.fleet.poses, hidden, this.world.lit, indicator, beacon, this.cameras.size[1] / 2);
    this.renderer.render(this.scene, camera);
    this.placeLabels();
    this.timeline.show(this.time, frame);
    const row = this.tracks.rowAt(this.selected, frame);
    this.panel.show(frame, row < 0 ? undefined : this.fleet.modeColour(this.selected, row), this.otherText());
    say(byId("clock"), `${this.time.toFixed(2)} / ${this.tracks.end.toFixed(2)} s`);
  }

  /** What the selected actor does in the other episode. */
  private otherText(): string {
    const pose = this.fleet.poses[this.selected];
    const twin = pose && this.ghosts?.twinSeenFrom(this.selected, pose);
    if (!twin || !this.ghosts) return "not there";
    const apart = Math.hypot(twin.ahead, twin.left);
    const where = apart < 0.05 ? "same place" : `${apart.toFixed(1)} m ${direction(twin.ahead, twin.left)}`;
    return `${(this.ghosts.tracks.speed[twin.row] * KMH).toFixed(1)} km/h, ${where}`;
  }

  /** Names the EMVs and the selected actor in the picture. */
  private placeLabels(): void {
    const [width, height] = this.cameras.size;
    const place = new Vector3();
    this.tracks.actors.forEach((actor, index) => {
      const pose = this.fleet.poses[index];
      const own = index === this.selected;
      if (!actor.emv && !own && !this.tags.has(index)) return;
      const tag = this.tags.get(index) ?? this.labels.appendChild(element("span", {}));
      this.tags.set(index, tag);
      if (pose) place.set(pose.x, pose.y, pose.z + actor.size_m[2] + 0.9).project(this.cameras.camera);
      const hidden = !pose || !(actor.emv || own) || place.z > 1 || (own && this.cameras.name === "driver");
      tag.hidden = hidden;
      if (hidden) return;
      tag.className = own ? "own" : "";
      say(tag, `${actor.emv ? "EMV" : words(actor.class)} ${actor.id} · ${(this.tracks.speed[pose.row] * KMH).toFixed(0)} km/h`);
      const x = ((place.x + 1) / 2) * width;
      const y = ((1 - place.y) / 2) * height - (this.cameras.name === "above" ? ABOVE_PX : 0);
      tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -100%)`;
    });
  }

  /** For programs that drive or check the page: the present moment. */
  get moment() {
    const actor = this.tracks.actors[this.selected]?.id ?? 0;
    return { time: this.time, actor, camera: this.cameras.name, playing: this.playing };
  }

  /** Poses as they were given to the graphics card for the present moment. */
  drawn() {
    this.draw();
    return this.fleet.drawn();
  }

  /** The same of the other episode, where it differs. */
  drawnOther() {
    this.draw();
    return this.ghosts?.drawn() ?? [];
  }

  /** Where an actor's middle is in the window, in pixels. */
  onScreen(id: number): [number, number] {
    const index = this.tracks.indexOf(id);
    const pose = this.fleet.poses[index];
    if (!pose) return [NaN, NaN];
    const place = new Vector3(pose.x, pose.y, pose.z + this.tracks.actors[index].size_m[2] / 2);
    this.cameras.camera.updateMatrixWorld();
    place.project(this.cameras.camera);
    const box = this.canvas.getBoundingClientRect();
    return [box.left + ((place.x + 1) / 2) * box.width, box.top + ((1 - place.y) / 2) * box.height];
  }

  /** Draw calls and triangles of the latest picture, and the script's times of the latest ones. */
  statistics() {
    const { calls, triangles } = this.renderer.info.render;
    return { calls, triangles, scriptMs: [...this.scriptMs] };
  }
}

function direction(ahead: number, left: number): string {
  if (Math.abs(ahead) >= Math.abs(left)) return ahead > 0 ? "ahead" : "behind";
  return left > 0 ? "to the left" : "to the right";
}

declare global {
  interface Window {
    episodePage?: EpisodePage;
  }
}

async function start(): Promise<void> {
  try {
    window.episodePage = new EpisodePage(await readEpisode(byId("episode").textContent ?? ""));
    byId("wait").hidden = true;
  } catch (error) {
    say(byId("wait"), `This page cannot be shown: ${error instanceof Error ? error.message : String(error)}`);
    throw error;
  }
}

void start();
