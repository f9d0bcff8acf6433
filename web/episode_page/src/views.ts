/** The pictures of one or more episodes beside or above each other on one canvas. */

import { SRGBColorSpace, WebGLRenderer } from "three";
import type { Cameras } from "./cameras";
import type { Stage } from "./stage";

const NARROW_PX = 600;

export class Views {
  shown: Stage[] = [];
  /** Of the canvas; to ask for it again would lay out the page in each picture. */
  private height = 0;
  private readonly renderer: WebGLRenderer;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly cameras: Cameras,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = SRGBColorSpace;
    this.renderer.info.autoReset = false;
    this.renderer.setScissorTest(true);
  }

  /** Shows episodes; the cameras are those of the first. */
  show(stages: Stage[]): void {
    for (const stage of this.shown) stage.take();
    this.shown = stages;
    this.layOut();
  }

  /** Fits the pictures into the canvas. */
  layOut(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.height = clientHeight;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight, false);
    const count = this.shown.length;
    const columns = count === 4 ? 2 : clientWidth < NARROW_PX ? 1 : count;
    const [width, height] = [clientWidth / columns, clientHeight / Math.ceil(count / columns)];
    this.shown.forEach((stage, place) =>
      stage.take([(place % columns) * width, Math.floor(place / columns) * height, width, height]));
    this.canvas.parentElement?.style.setProperty("--picture", `${width}px`);
    this.cameras.resize(width, height);
  }

  /** Draws all pictures; `rate` is how fast they play, and nothing flashes for `calm` readers. */
  draw(selected: number, rate: number, calm: boolean): void {
    this.renderer.info.reset();
    this.shown.forEach((stage, place) => {
      const [left, top, width, height] = stage.box;
      const below = this.height - top - height;
      this.renderer.setViewport(left, below, width, height);
      this.renderer.setScissor(left, below, width, height);
      if (place > 0) stage.match(this.cameras);
      const own = place > 0 ? stage.followed : selected;
      stage.draw(this.renderer, this.cameras, own, 1 / this.shown.length, rate, calm);
    });
  }

  /** Where an episode's picture is in the window. */
  boxOf({ box: [left, top, width, height] }: Stage): DOMRect {
    const canvas = this.canvas.getBoundingClientRect();
    return new DOMRect(canvas.left + left, canvas.top + top, width, height);
  }

  /** The episode whose picture is at a place of the window. */
  at(x: number, y: number): Stage | undefined {
    return this.shown.find((stage) => {
      const { left, right, top, bottom } = this.boxOf(stage);
      return x >= left && x < right && y >= top && y < bottom;
    });
  }

  /** Draw calls and triangles of the latest pictures together. */
  get counts(): { calls: number; triangles: number } {
    const { calls, triangles } = this.renderer.info.render;
    return { calls, triangles };
  }
}
