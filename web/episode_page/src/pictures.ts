/** A camera's picture in the picture: the latest one at each moment. */

import { byId } from "./dom";
import type { Episode } from "./episode";
import { latest } from "./sweeps";

interface Camera {
  times: number[];
  /** Where each picture begins in the bytes of all, and where the last one ends. */
  bounds: number[];
  bytes: Uint8Array<ArrayBuffer>;
}

export class Pictures {
  private readonly figure = byId("picture");
  private readonly canvas = byId<HTMLCanvasElement>("picture-canvas");
  private readonly choice = byId<HTMLSelectElement>("picture-camera");
  private readonly cameras: Camera[];
  private wanted = "";
  private drawnKey = "";
  private decoding = false;

  /** `changed` is called where another camera is chosen. */
  constructor(episode: Episode, entries: { name: string; shots: [step: number, length: number][] }[], changed: () => void) {
    this.cameras = entries.map(({ name, shots }, place) => {
      this.choice.add(new Option(name, String(place)));
      const bounds = [0];
      for (const [, length] of shots) bounds.push(bounds[bounds.length - 1] + length);
      const times = shots.map(([step]) => step * episode.head.step_s);
      return { times, bounds, bytes: episode.bytesOf(`pictures.${place}`) };
    });
    this.choice.addEventListener("change", changed);
    this.shown = true;
  }

  get shown(): boolean {
    return !this.figure.hidden;
  }

  set shown(shown: boolean) {
    this.figure.hidden = !shown;
  }

  /** Shows the picture of a time. */
  show(time: number): void {
    if (!this.shown) return;
    const place = Number(this.choice.value);
    this.wanted = `${place} ${latest(this.cameras[place].times, time)}`;
    if (!this.decoding) void this.decode();
  }

  /** One picture after the other: where they come faster than they are decoded, some are left out. */
  private async decode(): Promise<void> {
    this.decoding = true;
    while (this.drawnKey !== this.wanted) {
      const key = this.wanted;
      const [place, index] = key.split(" ").map(Number);
      const { bounds, bytes } = this.cameras[place];
      const context = this.canvas.getContext("2d");
      try {
        const jpeg = new Blob([bytes.subarray(bounds[Math.max(index, 0)], bounds[index + 1] ?? 0)], { type: "image/jpeg" });
        const bitmap = index < 0 ? undefined : await createImageBitmap(jpeg);
        [this.canvas.width, this.canvas.height] = [bitmap?.width ?? 4, bitmap?.height ?? 3];
        if (bitmap) context?.drawImage(bitmap, 0, 0);
        bitmap?.close();
      } catch {
        context?.clearRect(0, 0, this.canvas.width, this.canvas.height);
      }
      this.drawnKey = key;
    }
    this.decoding = false;
  }

  /** Camera and number of the picture that is shown. */
  get drawn(): string {
    return this.drawnKey;
  }
}
