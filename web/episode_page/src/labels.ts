/** Names of the EMVs and of the selected actor in the picture. */

import { Vector3, type Camera } from "three";
import { element, say, words } from "./dom";
import type { Pose, Tracks } from "./tracks";

const KMH = 3.6;

export class Labels {
  private readonly tags = new Map<number, HTMLElement>();
  private readonly place = new Vector3();

  constructor(
    private readonly tracks: Tracks,
    private readonly parent: HTMLElement,
  ) {}

  /** Puts the names over their actors, `above` pixels higher; none over `hidden`. */
  show(poses: (Pose | undefined)[], selected: number, hidden: number, camera: Camera, [width, height]: number[], above: number): void {
    const { place } = this;
    this.tracks.actors.forEach((actor, index) => {
      const pose = poses[index];
      const own = index === selected;
      if (!actor.emv && !own && !this.tags.has(index)) return;
      const tag = this.tags.get(index) ?? this.parent.appendChild(element("span", {}));
      this.tags.set(index, tag);
      if (pose) place.set(pose.x, pose.y, pose.z + actor.size_m[2] + 0.9).project(camera);
      tag.hidden = !pose || !(actor.emv || own) || place.z > 1 || index === hidden;
      if (tag.hidden || !pose) return;
      tag.className = own ? "own" : "";
      say(tag, `${actor.emv ? "EMV" : words(actor.class)} ${actor.id} · ${(this.tracks.speed[pose.row] * KMH).toFixed(0)} km/h`);
      const [x, y] = [((place.x + 1) / 2) * width, ((1 - place.y) / 2) * height - above];
      tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -100%)`;
    });
  }
}
