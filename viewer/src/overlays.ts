// What a drone senses and touches, and moving objects: beams and their hits, the camera's frustum, contacts.

import * as THREE from "three";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import { Line2 } from "three/examples/jsm/lines/Line2.js";
import { LineGeometry } from "three/examples/jsm/lines/LineGeometry.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { parts } from "./glb";
import type { Drones } from "./drones";
import type { BodyInfo, CameraInfo, Flight, LidarInfo } from "./flight";
import { dispose, glow } from "./world";

const beamColor = new THREE.Color(0xff8a4c);
const mostBeams = 16_384;
/** How long contacts are shown, s. */
const lastsS = 1.5;

export interface Layers {
  beams: boolean;
  frustum: boolean;
  contacts: boolean;
  path: boolean;
}

export class Overlays {
  readonly group = new THREE.Group();
  private readonly beams: THREE.LineSegments;
  private readonly hits: THREE.Points;
  private readonly frustum: LineSegments2;
  private readonly contacts: THREE.Sprite[] = [];
  private readonly paths: Line2[];
  private readonly looks: { info: BodyInfo; group: THREE.Group }[] = [];
  private making: Promise<void> = Promise.resolve();
  /** Moving objects by their slots: the look of each, and a copy of it. */
  private readonly slots: { look: number; group: THREE.Group }[] = [];

  private constructor(private readonly flight: Flight) {
    const beams = new THREE.BufferGeometry();
    beams.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * mostBeams), 3).setUsage(THREE.DynamicDrawUsage));
    beams.setAttribute("color", new THREE.BufferAttribute(new Float32Array(8 * mostBeams), 4).setUsage(THREE.DynamicDrawUsage));
    this.beams = new THREE.LineSegments(beams, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false }));
    const hits = new THREE.BufferGeometry();
    hits.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * mostBeams), 3).setUsage(THREE.DynamicDrawUsage));
    this.hits = new THREE.Points(hits, new THREE.PointsMaterial({ color: 0xffd9a0, map: glow(0).map, size: 13, sizeAttenuation: false, depthWrite: false, transparent: true, opacity: 0.95 }));
    this.frustum = new LineSegments2(new LineSegmentsGeometry().setPositions(new Float32Array(6 * 8 * Math.max(flight.cameras.length, 1))), new LineMaterial({ color: 0xc88cff, linewidth: 1.5, transparent: true, opacity: 0.8 }));
    const dashes = new LineMaterial({ color: 0xffffff, linewidth: 2, dashed: true, dashSize: 0.18, gapSize: 0.12, transparent: true, opacity: 0.75 });
    this.paths = flight.paths.map((points) => new Line2(new LineGeometry().setPositions(points.flat()), dashes).computeLineDistances());
    for (const shown of [this.beams, this.hits, this.frustum, ...this.paths]) {
      shown.frustumCulled = false;
      this.group.add(shown);
    }
  }

  static async make(flight: Flight): Promise<Overlays> {
    const overlays = new Overlays(flight);
    await overlays.makeLooks();
    return overlays;
  }

  /** Makes the looks of moving objects that are not there yet, and removes all others; one call after another. */
  makeLooks(): Promise<void> {
    return (this.making = this.making.then(() => this.makeMissing()));
  }

  private async makeMissing(): Promise<void> {
    const { looks, flight } = this;
    const kept = looks.findIndex(({ info }, i) => info !== flight.bodies[i]);
    if (kept >= 0) for (const slot of this.slots) slot.look = -1;
    for (const { group } of kept < 0 ? [] : looks.splice(kept)) dispose(group);
    for (const info of flight.bodies.slice(looks.length)) {
      const look = { info, group: new THREE.Group() };
      for (const part of await parts(info.glb)) {
        const material = new THREE.MeshLambertMaterial({ color: part.color, emissive: part.emissive, map: part.texture, vertexColors: part.geometry.hasAttribute("color"), flatShading: !part.isSmooth, side: THREE.DoubleSide });
        look.group.add(new THREE.Mesh(part.geometry, material));
      }
      looks.push(look);
    }
  }

  setResolution(width: number, height: number): void {
    for (const line of [this.frustum, ...this.paths]) line.material.resolution.set(width, height);
  }

  update(drone: number, env: number, seconds: number, drones: Drones, layers: Layers): void {
    const pose = drones.poses.get(drone);
    const step = this.flight.stepAt(seconds);
    this.updateBeams(layers.beams ? this.flight.lidars : [], drone, step, pose);
    this.frustum.visible = layers.frustum && !!pose && this.flight.cameras.length > 0;
    if (this.frustum.visible) this.frustum.geometry.setPositions(this.flight.cameras.flatMap((camera) => this.frustumOf(camera, pose!)));
    for (const [i, line] of this.paths.entries()) line.visible = layers.path && i === env % this.paths.length;
    this.updateContacts(layers.contacts, drones, step);
    this.updateBodies(env, seconds);
  }

  private updateBeams(lidars: LidarInfo[], drone: number, step: number, pose: Float64Array | undefined): void {
    const ends = this.beams.geometry.getAttribute("position") as THREE.BufferAttribute;
    const colors = this.beams.geometry.getAttribute("color") as THREE.BufferAttribute;
    const hits = this.hits.geometry.getAttribute("position") as THREE.BufferAttribute;
    let [beams, points] = [0, 0];
    const turn = new THREE.Quaternion();
    const spin = new THREE.Quaternion();
    const origin = new THREE.Vector3();
    const end = new THREE.Vector3();
    for (const lidar of pose ? lidars : []) {
      turn.set(pose![3], pose![4], pose![5], pose![6]);
      origin.set(...(lidar.offset_m as [number, number, number])).applyQuaternion(turn);
      origin.add(end.set(pose![0], pose![1], pose![2]));
      if (lidar.turn && lidar.turn_axes) {
        const angle = THREE.MathUtils.degToRad(this.flight.value(this.flight.column(lidar.turn)!, step, drone));
        turn.multiply(spin.setFromAxisAngle(end.fromArray(lidar.turn_axes[drone % lidar.turn_axes.length]), angle));
      }
      const ranges = this.flight.column(lidar.ranges)!;
      const directions = this.flight.column(lidar.directions)!.values;
      const count = ranges.shape[2];
      const own = directions.length > 3 * count ? 3 * count * drone : 0;
      const stride = Math.max(Math.ceil(count / (mostBeams - beams)), 1);
      for (let beam = 0; beam < count && beams < mostBeams; beam += stride) {
        const range = this.flight.value(ranges, step, drone * count + beam);
        const isHit = Number.isFinite(range);
        const reach = isHit ? range : lidar.reach_m;
        end.fromArray(directions, own + 3 * beam).applyQuaternion(turn).multiplyScalar(reach).add(origin);
        ends.setXYZ(2 * beams, origin.x, origin.y, origin.z);
        ends.setXYZ(2 * beams + 1, end.x, end.y, end.z);
        const dense = Math.min(40 / count + 0.12, 0.6);
        colors.setXYZW(2 * beams, beamColor.r, beamColor.g, beamColor.b, dense * 0.35);
        colors.setXYZW(2 * beams + 1, beamColor.r, beamColor.g, beamColor.b, isHit ? dense : 0);
        end.lerp(origin, Math.min(0.03 / Math.max(reach, 0.03), 1)); // before the surface, not half inside
        if (isHit) hits.setXYZ(points++, end.x, end.y, end.z);
        beams++;
      }
    }
    this.beams.geometry.setDrawRange(0, 2 * beams);
    this.hits.geometry.setDrawRange(0, points);
    for (const attribute of [ends, colors, hits]) attribute.needsUpdate = true;
  }

  private frustumOf(camera: CameraInfo, pose: Float64Array): number[] {
    const reach = 1.2;
    const [half, high] = camera.tangents.map((tangent) => reach * tangent);
    const turn = new THREE.Quaternion(pose[3], pose[4], pose[5], pose[6]);
    const [w, x, y, z] = camera.quat_wxyz;
    const mount = new THREE.Quaternion(x, y, z, w);
    const body = new THREE.Vector3(pose[0], pose[1], pose[2]);
    const offset = new THREE.Vector3(...(camera.offset_m as [number, number, number]));
    const place = (forward: number, left: number, up: number): THREE.Vector3 =>
      new THREE.Vector3(forward, left, up).applyQuaternion(mount).add(offset).applyQuaternion(turn).add(body);
    const eye = place(0, 0, 0);
    const corners = [place(reach, half, high), place(reach, -half, high), place(reach, -half, -high), place(reach, half, -high)];
    return corners.flatMap((corner, i) => [...eye, ...corner, ...corner, ...corners[(i + 1) % 4]]);
  }

  /** Lights up where drones touched something, for a moment. */
  private updateContacts(areShown: boolean, drones: Drones, step: number): void {
    const [hit, point] = [this.flight.column("contact.hit"), this.flight.column("contact.point")];
    const now = this.flight.timeAt(step);
    let used = 0;
    if (areShown && hit && point)
      for (const drone of drones.poses.keys()) {
        const first = this.flight.episodeStart(drone, step);
        for (let then = step; then >= first && now - this.flight.timeAt(then) < lastsS; then--) {
          const at = then * this.flight.drones + drone;
          if (!hit.values[at]) continue;
          const place = point.values.subarray(3 * at, 3 * at + 3);
          if (!place.every(Number.isFinite)) continue;
          if (used === this.contacts.length) {
            const sprite = new THREE.Sprite(glow(0xff4d3d));
            sprite.material.depthTest = false;
            this.contacts.push(sprite);
            this.group.add(sprite);
          }
          const sprite = this.contacts[used++];
          sprite.position.fromArray(place);
          sprite.scale.setScalar(0.9);
          sprite.material.opacity = 1 - (now - this.flight.timeAt(then)) / lastsS;
          break;
        }
      }
    for (const [i, sprite] of this.contacts.entries()) sprite.visible = i < used;
  }

  private updateBodies(env: number, seconds: number): void {
    const position = this.flight.column("bodies.position");
    const looks = this.flight.column("bodies.look");
    if (!position || !looks) return;
    const quat = this.flight.column("bodies.quat_wxyz")!;
    const [step, slots] = [this.flight.stepAt(seconds), position.shape[2]];
    const next = Math.min(step + 1, this.flight.steps - 1);
    const part = this.flight.episodeStart(env * this.flight.perEnv, next) <= step ? this.flight.partOf(step, seconds) : 0;
    for (let i = 0; i < slots; i++) {
      const [at, then] = [step, next].map((moment) => (moment * this.flight.envs + env) * slots + i);
      const slot = (this.slots[i] ??= { look: -1, group: new THREE.Group() });
      const { group } = slot;
      const look = this.looks[looks.values[at]] ? looks.values[at] : -1;
      group.visible = look >= 0;
      if (!group.visible) continue;
      if (look !== slot.look) this.group.add(group.clear().add(this.looks[look].group.clone()));
      slot.look = look;
      const [from, to] = [new THREE.Vector3(), new THREE.Vector3()];
      const isSame = looks.values[then] === look;
      group.position.copy(from.fromArray(position.values, 3 * at).lerp(to.fromArray(position.values, 3 * then), isSame ? part : 0));
      const [w, x, y, z] = quat.values.subarray(4 * at, 4 * at + 4);
      group.quaternion.set(x, y, z, w);
    }
  }
}
