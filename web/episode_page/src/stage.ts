/** One episode as it is drawn: its scene, with everything that stands or moves in it. */

import { Scene, type WebGLRenderer } from "three";
import type { Cameras } from "./cameras";
import type { Episode } from "./episode";
import { Fleet } from "./fleet";
import { Ghosts } from "./ghosts";
import { Glows } from "./glows";
import { Labels } from "./labels";
import type { Tracks } from "./tracks";
import { World } from "./world";

/** In the reader's time where it runs faster: more than three a second are harmful. */
const FLASHES_HZ = { indicator: 1.5, beacon: 2 };
/** From above, names stand this much higher than the middle of the vehicle, so that it is seen. */
const ABOVE_PX = 38;

export class Stage {
  readonly fleet: Fleet;
  readonly world: World;
  readonly ghosts: Ghosts | undefined;
  private readonly scene = new Scene();
  private readonly glows: Glows;
  private readonly labels: Labels;
  private time = 0;

  constructor(
    episode: Episode,
    private readonly tracks: Tracks,
    tags: HTMLElement,
  ) {
    const { against, lamps } = episode.head;
    this.world = new World(episode, this.scene);
    this.fleet = new Fleet(episode, tracks, this.scene);
    this.ghosts = against && new Ghosts(episode, against, tracks, this.scene);
    this.glows = new Glows(tracks, lamps.length, this.scene);
    this.labels = new Labels(tracks, tags);
  }

  seek(time: number): void {
    this.time = time;
    this.tracks.setTime(time);
    this.fleet.locate();
  }

  /** Draws the moment; `rate` is how fast it plays, and nothing flashes for `calm` readers. */
  draw(renderer: WebGLRenderer, cameras: Cameras, selected: number, rate: number, calm: boolean): void {
    const { fleet, world, time } = this;
    const { camera, name, size } = cameras;
    const phase = (hertz: number) => (calm || ((time * hertz) / Math.max(rate, 1)) % 1 < 0.5 ? 1 : 0);
    fleet.indicator.value = phase(FLASHES_HZ.indicator);
    fleet.beacon.value = calm ? 0.6 : phase(FLASHES_HZ.beacon);
    world.setFrame(this.tracks.frameAt(time));
    world.setView(camera, cameras.controls.target, cameras.distance);
    const hidden = name === "driver" ? selected : -1;
    fleet.place(camera.position, selected, hidden);
    this.ghosts?.place(time, fleet.poses);
    this.glows.place(fleet.poses, hidden, world.lit, fleet.indicator.value, fleet.beacon.value, size[1] / 2);
    renderer.render(this.scene, camera);
    this.labels.show(fleet.poses, selected, hidden, camera, size, name === "above" ? ABOVE_PX : 0);
  }
}
