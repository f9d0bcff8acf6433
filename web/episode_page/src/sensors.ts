/** What sensors measured: points of LiDARs in the scene and pictures of cameras, where the page has them. */

import type { Scene } from "three";
import { byId } from "./dom";
import type { Episode } from "./episode";
import { Pictures } from "./pictures";
import { Sweeps } from "./sweeps";

export type SensorKind = "sweeps" | "pictures";
/** Each kind with its key. */
export const SENSORS: [SensorKind, string][] = [["sweeps", "l"], ["pictures", "c"]];

export class Sensors {
  private readonly lidars: Sweeps[];
  private readonly pictures: Pictures | undefined;

  /** `changed` is called where another picture is to be shown. */
  constructor(episode: Episode, scene: Scene, private readonly changed: () => void) {
    const { lidars = [], cameras = [] } = episode.head.sensed ?? {};
    this.lidars = lidars.map(({ sweeps }, place) => new Sweeps(episode, place, sweeps, scene));
    if (cameras.length) this.pictures = new Pictures(episode, cameras, changed);
    byId("show-sweeps").hidden = lidars.length === 0;
    byId("show-pictures").hidden = cameras.length === 0;
  }

  /** Shows or hides a kind of sensor. */
  toggle(kind: SensorKind): void {
    const sensors = kind === "sweeps" ? this.lidars : this.pictures ? [this.pictures] : [];
    if (!sensors.length) return;
    const shown = !sensors[0].shown;
    for (const sensor of sensors) sensor.shown = shown;
    byId(`show-${kind}`).setAttribute("aria-pressed", String(shown));
    this.changed();
  }

  /** Shows what was measured last at a time. */
  show(time: number): void {
    for (const sweeps of this.lidars) sweeps.place(time);
    this.pictures?.show(time);
  }

  /** Places of the points that are drawn, in the map. */
  drawn(): [number, number, number][] {
    return this.lidars.flatMap((sweeps) => sweeps.drawn());
  }
}
