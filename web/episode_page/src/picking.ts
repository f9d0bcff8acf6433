/** From a place in the picture to what is there, and back. */

import { Raycaster, Vector2, Vector3, type Camera, type Ray } from "three";

const CLICK_PX = 6;

/** Calls for each click or tap that is no drag. */
export function listenToClicks(canvas: HTMLElement, clicked: (event: PointerEvent) => void): void {
  const down = new Vector2();
  canvas.addEventListener("pointerdown", (event) => down.set(event.clientX, event.clientY));
  canvas.addEventListener("pointerup", (event) => {
    if (down.distanceTo(new Vector2(event.clientX, event.clientY)) < CLICK_PX) clicked(event);
  });
}

/** The ray of sight through a place of the window; `box` is where the camera's picture is. */
export function rayThrough(x: number, y: number, box: DOMRect, camera: Camera): Ray {
  const place = new Vector2((2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height);
  const caster = new Raycaster();
  caster.setFromCamera(place, camera);
  return caster.ray;
}

/** Where a point of the scene is in the window. */
export function placeInWindow(point: Vector3, box: DOMRect, camera: Camera): [number, number] {
  camera.updateMatrixWorld();
  const { x, y } = point.clone().project(camera);
  return [box.left + ((x + 1) / 2) * box.width, box.top + ((1 - y) / 2) * box.height];
}
