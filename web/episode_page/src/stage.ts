/** One episode as it is drawn: its scene, with everything that stands or moves in it, and its part of the picture. */

import { Scene, type PerspectiveCamera, type Vector3, type WebGLRenderer } from "three";
import type { Cameras } from "./cameras";
import { byId, element } from "./dom";
import type { Episode, Part } from "./episode";
import { Fleet } from "./fleet";
import type { Ghosts } from "./ghosts";
import { Glows } from "./glows";
import { Labels } from "./labels";
import type { Tracks } from "./tracks";
import { World } from "./world";

/** In the reader's time where it runs faster: more than three a second are harmful. */
const FLASHES_HZ = { indicator: 1.5, beacon: 2 };
/** From above, names stand this much higher than the middle of the vehicle, so that it is seen. */
const ABOVE_PX = 38;

export class Stage {
  fleet: Fleet;
  readonly world: World;
  readonly scene = new Scene();
  readonly ghosts: Ghosts[] = [];
  /** Place of the actor that is asked for; -1 for one who is not in this episode. */
  wanted = -1;
  /** Where its picture is: left, top, width and height within the canvas. */
  box: [number, number, number, number] = [0, 0, 1, 1];
  private glows: Glows;
  private readonly labels: Labels;
  private readonly sheet: HTMLElement;
  private time = 0;

  constructor(
    private readonly episode: Episode,
    private readonly part: Part,
    readonly tracks: Tracks,
    readonly camera: PerspectiveCamera,
    readonly target: Vector3,
    title = "",
  ) {
    this.world = new World(episode, part, this.scene);
    this.fleet = new Fleet(episode, tracks, this.scene);
    this.glows = new Glows(tracks, episode.lampsOf(part).length, this.scene);
    this.sheet = byId("labels").appendChild(element("div", {}, ...(title ? [element("b", {}, title)] : [])));
    this.labels = new Labels(tracks, this.sheet);
  }

  /** Draws the actors that the tracks have now. */
  admit(): void {
    for (const part of [this.fleet, this.glows]) part.dispose();
    this.fleet = new Fleet(this.episode, this.tracks, this.scene);
    this.glows = new Glows(this.tracks, this.episode.lampsOf(this.part).length, this.scene);
    this.seek(this.time);
  }

  seek(time: number): void {
    this.time = time;
    this.tracks.setTime(time);
    this.fleet.locate();
  }

  /** Takes its part of the picture; none where there is no box. */
  take(box?: [number, number, number, number]): void {
    this.sheet.hidden = !box;
    if (!box) return;
    this.box = box;
    ["left", "top", "width", "height"].forEach((name, place) => this.sheet.style.setProperty(name, `${box[place]}px`));
  }

  /** The actor that is asked for or, where it is not there, an EMV that is. */
  get followed(): number {
    const { poses } = this.fleet;
    return poses[this.wanted] ? this.wanted : (this.tracks.emvs.find((index) => poses[index]) ?? this.wanted);
  }

  /** Turns its camera to its own actor as another episode's is turned to the one there. */
  match(cameras: Cameras): void {
    const pose = this.fleet.poses[this.followed];
    if (pose) cameras.match(this.camera, this.target, this.tracks.actors[this.followed], pose, this.part.left_hand);
  }

  /** Draws the moment with `share` of the triangles. `rate` is how fast it plays; nothing flashes for `calm` readers. */
  draw(renderer: WebGLRenderer, cameras: Cameras, selected: number, share: number, rate: number, calm: boolean): void {
    const { fleet, world, time, camera, box: [, , width, height] } = this;
    const phase = (hertz: number) => (calm || ((time * hertz) / Math.max(rate, 1)) % 1 < 0.5 ? 1 : 0);
    fleet.indicator.value = phase(FLASHES_HZ.indicator);
    fleet.beacon.value = calm ? 0.6 : phase(FLASHES_HZ.beacon);
    world.setStep(Math.floor(time / this.episode.head.step_s + 1e-6));
    world.setView(camera, this.target, cameras.distance);
    const hidden = cameras.name === "driver" ? selected : -1;
    fleet.place(camera.position, selected, hidden, share);
    for (const ghosts of this.ghosts) ghosts.place(fleet.poses);
    this.glows.place(fleet.poses, hidden, world.lit, fleet.indicator.value, fleet.beacon.value, height / 2);
    renderer.render(this.scene, camera);
    this.labels.show(fleet.poses, selected, hidden, camera, [width, height], cameras.name === "above" ? ABOVE_PX : 0);
  }
}
