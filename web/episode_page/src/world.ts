/** Everything that does not move: ground, buildings and trees as one mesh, light and sky, and the signals' lenses. */

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  Fog,
  HemisphereLight,
  Mesh,
  MeshBasicMaterial,
  Vector3,
  type Camera,
  type Scene,
} from "three";
import type { Episode, Lamp, Part } from "./episode";
import { geometryOf, tintedMaterial } from "./tinted";

const LENS = { red: [1, 0.08, 0.05], yellow: [1, 0.65, 0.04], green: [0.05, 0.9, 0.45] } as const;
const DARK = 0.09;

/** A lens that shines: its place and colour. */
export interface LitLens {
  place: [number, number, number];
  rgb: readonly [number, number, number];
}

export class World {
  lit: LitLens[] = [];
  private readonly fog = new Fog(0xffffff);
  private readonly sky = new Color();
  private readonly sun = new DirectionalLight(0xfff4e2);
  private readonly daylight = new HemisphereLight(0xe4eefb, 0x8a8570);
  private readonly lenses: Mesh<BufferGeometry, MeshBasicMaterial>;
  private readonly centres: [number, number, number][] = [];
  private readonly focus = { value: new Vector3() };
  private readonly lamps: Lamp[];
  private shown = "";

  constructor(
    private readonly episode: Episode,
    private readonly part: Part,
    scene: Scene,
  ) {
    const ground = new Mesh(geometryOf(episode, `${part.scene}static`), tintedMaterial({ focus: this.focus }));
    ground.matrixAutoUpdate = false;
    const corners = episode.numbers(`${part.scene}lamp.corners`);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(corners.length), 3));
    this.lenses = new Mesh(geometry, new MeshBasicMaterial({ vertexColors: true, toneMapped: false }));
    let first = 0;
    this.lamps = episode.lampsOf(part);
    for (const [, , , count] of this.lamps) {
      const mean = (axis: number) => {
        let sum = 0;
        for (let i = first; i < first + count; i++) sum += corners[3 * i + axis];
        return sum / count;
      };
      this.centres.push([mean(0), mean(1), mean(2)]);
      first += count;
    }
    this.sun.position.set(-0.45, -0.35, 0.85);
    scene.fog = this.fog;
    scene.background = this.sky;
    scene.add(ground, this.lenses, this.sun, this.daylight);
  }

  /** Day or dusk. */
  setDark(dark: boolean): void {
    this.sky.set(dark ? 0x141b26 : 0xc4d8ea);
    this.fog.color.copy(this.sky);
    this.sun.intensity = dark ? 0.55 : 2.4;
    this.daylight.intensity = dark ? 0.8 : 2.3;
    this.sun.color.set(dark ? 0x9db4e0 : 0xfff4e2);
  }

  /** Fog begins behind what the camera looks at, and nothing hides it; without a distance the camera is there itself. */
  setView(camera: Camera, target: Vector3, distance: number): void {
    camera.updateMatrixWorld();
    if (distance > 0) this.focus.value.copy(target).applyMatrix4(camera.matrixWorldInverse);
    else this.focus.value.set(0, 0, 0);
    this.fog.near = 220 + 1.5 * distance;
    this.fog.far = 900 + 5 * distance;
  }

  /** Shows the signals as they are from a step on. */
  setStep(step: number): void {
    const states = new Map<string, string>();
    for (const [signal, changes] of Object.entries(this.part.signals)) {
      let state = "";
      for (const [since, next] of changes) {
        if (since > step) break;
        state = next;
      }
      states.set(signal, state);
    }
    const key = [...states.values()].join(" ");
    if (key === this.shown) return;
    this.shown = key;
    this.lit = [];
    const colours = this.lenses.geometry.getAttribute("color");
    let corner = 0;
    this.lamps.forEach((lamp, index) => {
      const lit = this.isLit(lamp, states.get(lamp[0]) ?? "");
      const rgb = LENS[lamp[2]];
      if (lit) this.lit.push({ place: this.centres[index], rgb });
      const [red, green, blue] = rgb.map((part) => (lit ? part : part * DARK));
      for (let i = 0; i < lamp[3]; i++) colours.setXYZ(corner++, red, green, blue);
    });
    colours.needsUpdate = true;
  }

  private isLit([, link, colour]: Lamp, state: string): boolean {
    return link < state.length && (this.episode.head.lamp_letters[colour] ?? "").includes(state[link]);
  }
}
