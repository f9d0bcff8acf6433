/** What the page's buttons and keys do. */

import { CAMERAS } from "./cameras";
import { byId } from "./dom";
import { listenToKeys, type Keys } from "./keyboard";
import type { EpisodePage } from "./page";
import { SENSORS } from "./sensors";

export function bindControls(page: EpisodePage): void {
  const { clock } = page;
  const keys: Keys = {
    Home: () => page.seek(0),
    End: () => page.seek(page.end),
    a: () => page.moveCamera(-0.1, 1),
    d: () => page.moveCamera(0.1, 1),
    w: () => page.moveCamera(0, 0.9),
    s: () => page.moveCamera(0, 1 / 0.9),
    "+": () => clock.faster(1),
    "-": () => clock.faster(-1),
  };
  const bind = (id: string, key: string, action: (shift: boolean) => void) => {
    byId(id).addEventListener("click", () => action(false));
    keys[key] = action;
  };
  bind("play", " ", () => page.play(!clock.playing));
  bind("back", "ArrowLeft", (shift) => (shift ? page.seek(clock.time - 1) : clock.step(-1)));
  bind("ahead", "ArrowRight", (shift) => (shift ? page.seek(clock.time + 1) : clock.step(1)));
  bind("previous-actor", "p", () => page.selectNext(-1));
  bind("next-actor", "n", () => page.selectNext(1));
  bind("overlay", "o", () => page.showOthers(!page.overlaid));
  bind("side", "b", () => page.showBeside(!page.moment.beside));
  for (const [name, key] of SENSORS) bind(`show-${name}`, key, () => page.toggleSensor(name));
  CAMERAS.forEach((name, place) => bind(`camera-${name}`, String(place + 1), () => page.useCamera(name)));
  listenToKeys(keys);
}
