// The viewer's camera: around a drone, behind it, at its eye, or free.

import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

export const modes = ["orbit", "follow", "eye", "free"] as const;
export type Mode = (typeof modes)[number];

/** How fast the camera behind a drone catches up, 1/s. */
const catchUp = 4;

export class Viewer {
  readonly camera = new THREE.PerspectiveCamera(50, 1, 0.03, 2000);
  readonly controls: OrbitControls;
  mode: Mode = "orbit";
  private heading = NaN;
  private readonly held = new Set<string>();
  /** Radius of a drone, m: the camera behind it keeps a distance that fits. */
  radius = 0.3;
  /** The mount of the drone's camera: offset in m, rotation, tangents of half the fields of view. */
  eye = { offset: new THREE.Vector3(0.15, 0, 0.03), turn: new THREE.Quaternion(), tangents: [1, 0.75] };

  constructor(element: HTMLElement, changed: () => void) {
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, element);
    this.controls.enableDamping = false;
    this.controls.zoomToCursor = false;
    this.controls.addEventListener("change", changed);
  }

  /** Looks at a world from a height, towards where drones begin. */
  frame(bounds: THREE.Box3, target: THREE.Vector3): void {
    const size = bounds.getSize(new THREE.Vector3());
    const distance = Math.min(Math.max(0.5 * Math.hypot(size.x, size.y), 4), 13);
    this.controls.target.copy(target);
    const away = bounds.getCenter(new THREE.Vector3()).sub(target).setZ(0);
    const angle = away.lengthSq() > 0.01 ? Math.atan2(away.y, away.x) + Math.PI + 0.3 : -2.2;
    this.camera.position.set(Math.cos(angle) * 0.72, Math.sin(angle) * 0.72, 0.62).multiplyScalar(distance).add(target);
    this.controls.update();
  }

  /** Returns whether keys move the free camera. */
  get isMoving(): boolean {
    return this.mode === "free" && this.held.size > 0;
  }

  hold(key: string, isDown: boolean): void {
    if (isDown) this.held.add(key);
    else this.held.delete(key);
  }

  /** Follows a pose (position, quaternion x, y, z, w) over some seconds; without one the camera stays. */
  update(pose: Float64Array | undefined, seconds: number, jumps: boolean): void {
    const { camera, controls } = this;
    controls.enabled = this.mode !== "eye";
    if (this.mode === "free") this.move(seconds);
    if (!pose || this.mode === "free") {
      controls.update();
      return;
    }
    const place = new THREE.Vector3(pose[0], pose[1], pose[2]);
    const turn = new THREE.Quaternion(pose[3], pose[4], pose[5], pose[6]);
    if (this.mode === "eye") {
      camera.position.copy(this.eye.offset).applyQuaternion(turn).add(place);
      const forward = turn.clone().multiply(this.eye.turn);
      const axis = (x: number, y: number, z: number): THREE.Vector3 => new THREE.Vector3(x, y, z).applyQuaternion(forward);
      camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(axis(0, -1, 0), axis(0, 0, 1), axis(-1, 0, 0)));
      this.heading = NaN;
      return;
    }
    const offset = camera.position.clone().sub(controls.target);
    if (this.mode === "follow") {
      const forward = new THREE.Vector3(1, 0, 0).applyQuaternion(turn);
      const wanted = Math.atan2(forward.y, forward.x);
      let by = Number.isNaN(this.heading) ? 0 : Math.atan2(Math.sin(wanted - this.heading), Math.cos(wanted - this.heading));
      if (Number.isNaN(this.heading)) {
        this.heading = wanted;
        offset.set(-Math.cos(wanted), -Math.sin(wanted), 0.25).multiplyScalar(1 + 5 * this.radius);
      } else {
        by *= jumps ? 1 : 1 - Math.exp(-catchUp * seconds);
        offset.applyAxisAngle(new THREE.Vector3(0, 0, 1), by);
        this.heading += by;
      }
      place.z += 0.17 * offset.length(); // the drone in the lower half, and above it the way ahead
    } else this.heading = NaN;
    controls.target.copy(place);
    camera.position.copy(place).add(offset);
    controls.update();
  }

  private move(seconds: number): void {
    const along = (positive: string, negative: string): number => (this.held.has(positive) ? 1 : 0) - (this.held.has(negative) ? 1 : 0);
    const local = new THREE.Vector3(along("d", "a"), 0, -along("w", "s")).applyQuaternion(this.camera.quaternion);
    local.z += along("e", "q");
    if (local.lengthSq() === 0) return;
    local.setLength((this.held.has("shift") ? 12 : 4) * seconds);
    this.camera.position.add(local);
    this.controls.target.add(local);
  }

  /** Sets the field of view for a size in pixels. */
  resize(width: number, height: number): void {
    const { camera } = this;
    camera.aspect = width / Math.max(height, 1);
    if (this.mode === "eye") {
      const [across, up] = this.eye.tangents;
      camera.fov = (360 / Math.PI) * Math.atan(Math.min(Math.max(up, across / camera.aspect), 4)); // all that it sees
    } else camera.fov = 50;
    camera.updateProjectionMatrix();
  }
}
