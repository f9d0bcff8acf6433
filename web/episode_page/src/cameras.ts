/** Four cameras: around the selected actor, from above, behind it, and from its driver's eyes. */

import { MOUSE, PerspectiveCamera, TOUCH, Vector3 } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Actor } from "./episode";
import type { Pose } from "./tracks";

export const CAMERAS = ["follow", "orbit", "above", "driver"] as const;
export type CameraName = (typeof CAMERAS)[number];

const UP = new Vector3(0, 0, 1);
const BEHIND_M = 17;
const HIGH_M = 7;
const ABOVE_M = 95;
const AROUND = new Vector3(-26, -34, 24);

export function newCamera(): PerspectiveCamera {
  const camera = new PerspectiveCamera(50, 1, 0.15, 6000);
  camera.up.copy(UP);
  return camera;
}

export class Cameras {
  readonly camera = newCamera();
  readonly controls: OrbitControls;
  name: CameraName = "follow";
  private followed = -1;
  private last: Pose | undefined;
  private look = { yaw: 0, pitch: 0 };

  constructor(
    canvas: HTMLCanvasElement,
    private readonly leftHand: boolean,
    smooth: boolean,
  ) {
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = smooth;
    this.controls.minDistance = 4;
    this.controls.maxDistance = 1500;
    canvas.addEventListener("pointermove", (event) => {
      if (this.name !== "driver" || event.buttons === 0) return;
      this.look.yaw += event.movementX * 0.005;
      this.look.pitch = Math.min(Math.max(this.look.pitch + event.movementY * 0.004, -0.9), 0.9);
      this.controls.dispatchEvent({ type: "change" });
    });
  }

  /** Takes a camera; its first picture shows the actor at its pose. */
  use(name: CameraName, pose: Pose | undefined): void {
    this.name = name;
    const { controls, camera } = this;
    controls.enabled = name !== "driver";
    controls.enableRotate = name !== "above";
    controls.screenSpacePanning = name === "above";
    controls.minPolarAngle = 0;
    controls.maxPolarAngle = name === "above" ? 0 : 1.53;
    controls.mouseButtons.LEFT = name === "above" ? MOUSE.PAN : MOUSE.ROTATE;
    controls.touches.ONE = name === "above" ? TOUCH.PAN : TOUCH.ROTATE;
    this.look = { yaw: 0, pitch: 0 };
    if (pose) controls.target.set(pose.x, pose.y, pose.z + (name === "above" ? 0 : 1.2));
    const { target } = controls;
    if (name === "follow") camera.position.set(-BEHIND_M, 0, HIGH_M).applyAxisAngle(UP, pose?.yaw ?? 0).add(target);
    if (name === "orbit") camera.position.copy(AROUND).add(target);
    // Not straight above: the controls keep this side, the south, at the bottom of the picture.
    if (name === "above") camera.position.set(target.x, target.y - 1e-3, target.z + ABOVE_M * this.zoomOut());
    this.last = pose ? { ...pose } : undefined;
    if (name !== "driver") controls.update();
  }

  /** Narrow pictures are seen from farther away. */
  private zoomOut(): number {
    return Math.max(1, 1.2 / Math.sqrt(this.camera.aspect));
  }

  resize(width: number, height: number): void {
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.fov = this.camera.aspect < 1 ? 62 : 50;
    this.camera.updateProjectionMatrix();
  }

  /** Moves the camera along with the actor; says whether it still moves by itself. */
  update(index: number, actor: Actor | undefined, pose: Pose | undefined): boolean {
    const { camera, controls, last } = this;
    if (pose && index !== this.followed) {
      // Around and from above, another actor is seen as the one before was.
      const kept = this.followed >= 0 && (this.name === "orbit" || this.name === "above");
      this.followed = index;
      if (kept) this.shift(new Vector3(pose.x, pose.y, pose.z).sub(controls.target));
      else this.use(this.name, pose);
    } else if (pose && last && this.name !== "driver") {
      if (this.name === "follow") {
        camera.position.sub(controls.target).applyAxisAngle(UP, pose.yaw - last.yaw).add(controls.target);
      }
      this.shift(new Vector3(pose.x - last.x, pose.y - last.y, pose.z - last.z));
    }
    if (pose) this.last = { ...pose };
    if (this.name === "driver" && pose && actor) {
      this.sit(camera, controls.target, actor, pose, this.leftHand);
      return false;
    }
    return controls.enabled && controls.update();
  }

  private shift(by: Vector3): void {
    this.camera.position.add(by);
    this.controls.target.add(by);
  }

  /** Turns the camera around what it looks at, and brings it nearer by a factor; for the keyboard. */
  move(turn: number, nearer: number): void {
    if (this.name === "driver") this.look.yaw += turn;
    const offset = this.camera.position.clone().sub(this.controls.target).multiplyScalar(nearer);
    if (this.name !== "above") offset.applyAxisAngle(UP, turn);
    this.camera.position.copy(this.controls.target).add(offset);
  }

  /** Turns a camera of another episode, with the place that it looks at, to an actor as this one is turned to its own. */
  match(camera: PerspectiveCamera, target: Vector3, actor: Actor, pose: Pose, leftHand: boolean): void {
    [camera.fov, camera.aspect] = [this.camera.fov, this.camera.aspect];
    camera.updateProjectionMatrix();
    if (this.name === "driver") return this.sit(camera, target, actor, pose, leftHand);
    const { x, y, z, yaw } = this.last ?? pose;
    const turn = this.name === "follow" ? pose.yaw - yaw : 0;
    const moved = (from: Vector3, to: Vector3) =>
      to.set(from.x - x, from.y - y, from.z - z).applyAxisAngle(UP, turn).add(pose);
    moved(this.camera.position, camera.position);
    moved(this.controls.target, target);
    camera.quaternion.setFromAxisAngle(UP, turn).multiply(this.camera.quaternion);
  }

  private sit(camera: PerspectiveCamera, target: Vector3, actor: Actor, pose: Pose, leftHand: boolean): void {
    const [length, width, height] = actor.size_m;
    const walks = actor.class === "PEDESTRIAN" || actor.class === "BICYCLE" || actor.class === "MOTORCYCLE";
    const large = actor.class === "BUS" || actor.class === "TRUCK" || actor.class === "FIRE_TRUCK";
    const ahead = walks ? 0 : large ? length / 2 - 1.1 : Math.min(0.12 * length, length / 2 - 1.6);
    const left = walks ? 0 : (leftHand ? -1 : 1) * 0.2 * width;
    const up = walks ? 0.95 * height : large ? 0.72 * height : Math.min(0.82 * height, 1.95);
    const [c, s] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
    camera.position.set(pose.x + c * ahead - s * left, pose.y + s * ahead + c * left, pose.z + up);
    const [yaw, flat] = [pose.yaw + this.look.yaw, Math.cos(this.look.pitch)];
    camera.lookAt(
      camera.position.x + Math.cos(yaw) * flat,
      camera.position.y + Math.sin(yaw) * flat,
      camera.position.z - 0.06 - Math.sin(this.look.pitch),
    );
    camera.updateMatrixWorld();
    target.set(pose.x, pose.y, pose.z + 1.2);
  }

  /** From the camera to what it looks at. */
  get distance(): number {
    return this.name === "driver" ? 0 : this.camera.position.distanceTo(this.controls.target);
  }
}
