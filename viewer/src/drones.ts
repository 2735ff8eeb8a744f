// The drones of a flight: instances of one mesh with turning rotors, their trails, shadows on the ground.

import * as THREE from "three";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { parts } from "./glb";
import type { Flight } from "./flight";
import { glow } from "./world";

const palette = ["#4cc2ff", "#ff9d5c", "#5fe3a1", "#d79bff", "#ffd75e", "#ff7d9c", "#6ee7e7", "#b8c4ff", "#c5e86c", "#ffb3d1"];
export const droneColor = (drone: number): string => palette[drone % palette.length];
export const ghostColor = "#ff8a5b";

const trailPoints = 30_000; // of all drones together
const mostPoints = 600; // of a drone
/** Blades turn slower than real ones, whose pictures would stand still or turn backwards. */
const slowed = 0.045;
const hoverRadps = 500;

export interface Shown {
  flight: Flight;
  drones: number[];
  seconds: number;
  /** A drone that the viewer looks out of. */
  hidden: number | null;
}

export class Drones {
  readonly group = new THREE.Group();
  /** Pose of each shown drone: position, then quaternion x, y, z, w. */
  readonly poses = new Map<number, Float64Array>();
  private body: THREE.InstancedMesh[] = [];
  private hull: THREE.InstancedMesh[] = [];
  private blades: THREE.InstancedMesh[] = [];
  private discs!: THREE.InstancedMesh;
  private readonly drops: THREE.InstancedMesh;
  /** A light of a few pixels around each drone, which shows it from afar. */
  private readonly lights: THREE.Points;
  private readonly trail: LineSegments2;
  private readonly places: THREE.InstancedInterleavedBuffer;
  private readonly tints: THREE.InstancedInterleavedBuffer;
  private readonly capacity: number;
  private readonly angles: Float64Array;

  private constructor(
    private readonly flight: Flight,
    private readonly isGhost: boolean,
  ) {
    this.capacity = flight.drones;
    this.angles = new Float64Array(flight.drone.hubs.length);
    const drop = new THREE.CircleGeometry(1, 32);
    const soft = new THREE.MeshBasicMaterial({ color: 0, map: glow(0).map, transparent: true, opacity: isGhost ? 0.6 : 1.6, depthWrite: false });
    this.drops = new THREE.InstancedMesh(drop, soft, this.capacity);
    this.drops.frustumCulled = false;
    this.drops.renderOrder = 1;
    const lights = new THREE.BufferGeometry();
    for (const name of ["position", "color"]) lights.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * this.capacity), 3).setUsage(THREE.DynamicDrawUsage));
    this.lights = new THREE.Points(lights, new THREE.PointsMaterial({ map: glow(0).map, size: isGhost ? 20 : 30, sizeAttenuation: false, vertexColors: true, transparent: true, depthWrite: false, blending: THREE.AdditiveBlending }));
    this.lights.frustumCulled = false;
    const geometry = new LineSegmentsGeometry();
    const segments = Math.max(trailPoints, 2 * flight.drones);
    this.places = new THREE.InstancedInterleavedBuffer(new Float32Array(6 * segments), 6, 1);
    this.tints = new THREE.InstancedInterleavedBuffer(new Float32Array(6 * segments), 6, 1);
    for (const [name, buffer] of [["instance", this.places], ["instanceColor", this.tints]] as const) {
      buffer.setUsage(THREE.DynamicDrawUsage);
      geometry.setAttribute(`${name}Start`, new THREE.InterleavedBufferAttribute(buffer, 3, 0));
      geometry.setAttribute(`${name}End`, new THREE.InterleavedBufferAttribute(buffer, 3, 3));
    }
    const line = new LineMaterial({ linewidth: isGhost ? 1.6 : 2.4, vertexColors: true, transparent: true, opacity: isGhost ? 0.65 : 0.95, dashed: false });
    this.trail = new LineSegments2(geometry, line);
    this.trail.frustumCulled = false;
    this.group.add(this.drops, this.lights, this.trail);
  }

  static async make(flight: Flight, isGhost: boolean): Promise<Drones> {
    const drones = new Drones(flight, isGhost);
    drones.body = await drones.meshes(flight.drone.glb);
    if (flight.drone.hull) drones.hull = await drones.meshes(flight.drone.hull);
    drones.addRotors();
    return drones;
  }

  /** Radius of a drone around its origin, m. */
  get radius(): number {
    return Math.max(0.05, ...this.body.map(({ geometry: { boundingSphere } }) => boundingSphere!.center.length() + boundingSphere!.radius));
  }

  private async meshes(glb: Uint8Array): Promise<THREE.InstancedMesh[]> {
    const { isGhost } = this;
    return (await parts(glb)).map((part) => {
      const material = new THREE.MeshPhongMaterial({
        color: part.color.clone().lerp(new THREE.Color(isGhost ? ghostColor : 0xffffff), isGhost ? 0.75 : 0),
        vertexColors: part.geometry.hasAttribute("color"),
        flatShading: true,
        shininess: 40,
        specular: 0x22262e,
        side: THREE.DoubleSide,
        transparent: isGhost,
        opacity: isGhost ? 0.5 : 1,
      });
      return this.instances(part.geometry, material);
    });
  }

  private instances(geometry: THREE.BufferGeometry, material: THREE.Material, each = 1): THREE.InstancedMesh {
    const mesh = new THREE.InstancedMesh(geometry, material, this.capacity * each);
    mesh.frustumCulled = false;
    mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    this.group.add(mesh);
    return mesh;
  }

  private addRotors(): void {
    const { hubs, rotor_m: radius } = this.flight.drone;
    const count = Math.max(hubs.length, 1);
    const disc = new THREE.MeshBasicMaterial({ color: this.isGhost ? ghostColor : 0xbfd4ee, transparent: true, opacity: this.isGhost ? 0.1 : 0.16, depthWrite: false, side: THREE.DoubleSide });
    this.discs = this.instances(new THREE.CircleGeometry(radius || 1, 40), disc, count);
    if (!hubs.length) return;
    const chord = radius * 0.11;
    for (const isFront of [true, false]) {
      const blade = new THREE.BoxGeometry(2 * radius * 0.97, chord, radius * 0.02);
      const color = this.isGhost ? ghostColor : isFront ? "#ff6b35" : "#8fa6c9";
      this.blades.push(this.instances(blade, new THREE.MeshPhongMaterial({ color, transparent: this.isGhost, opacity: this.isGhost ? 0.5 : 1 }), count));
    }
  }

  setResolution(width: number, height: number): void {
    this.trail.material.resolution.set(width, height);
  }

  /** Places all that is shown at a time. */
  update({ flight, drones, seconds, hidden }: Shown, layers: { trails: boolean; shadows: boolean; hull: boolean }): void {
    const step = flight.stepAt(seconds);
    const matrix = new THREE.Matrix4();
    const local = new THREE.Matrix4();
    const one = new THREE.Vector3(1, 1, 1);
    const position = new THREE.Vector3();
    const quat = new THREE.Quaternion();
    const { hubs, spins } = flight.drone;
    const speeds = flight.column("rotor_speed");
    const ground = flight.column("above_m");
    const size = flight.drone.rotor_m + Math.max(...hubs.map(([x, y]) => Math.hypot(x, y)), 0);
    const lights = ["position", "color"].map((name) => this.lights.geometry.getAttribute(name) as THREE.BufferAttribute);
    const color = new THREE.Color();
    const isHull = layers.hull && this.hull.length > 0;
    const bodies = isHull ? this.hull : this.body;
    for (const mesh of this.hull) mesh.visible = isHull;
    for (const mesh of [...this.body, ...this.blades, this.discs]) mesh.visible = !isHull;
    let [count, front, rear, dropped] = [0, 0, 0, 0];
    this.poses.clear();
    for (const drone of drones) {
      const pose = new Float64Array(7);
      if (!flight.pose(drone, seconds, pose)) continue; // NaN: nothing to show
      this.poses.set(drone, pose);
      if (!flight.isActive(drone, step) || drone === hidden) continue;
      position.set(pose[0], pose[1], pose[2]);
      quat.set(pose[3], pose[4], pose[5], pose[6]);
      matrix.compose(position, quat, one);
      for (const mesh of bodies) mesh.setMatrixAt(count, matrix);
      lights[0].setXYZ(count, pose[0], pose[1], pose[2]);
      color.set(this.isGhost ? ghostColor : droneColor(drone));
      lights[1].setXYZ(count, color.r, color.g, color.b);
      for (const [rotor, [x, y, z]] of hubs.entries()) {
        const radps = speeds && rotor < speeds.shape[2] ? flight.value(speeds, step, drone * speeds.shape[2] + rotor) : hoverRadps;
        this.angles[rotor] = seconds * slowed * hoverRadps * spins[rotor] + rotor;
        local.makeTranslation(x, y, z).premultiply(matrix);
        this.discs.setMatrixAt(count * hubs.length + rotor, radps > 20 ? local : local.clone().scale(new THREE.Vector3(0, 0, 0)));
        if (!this.blades.length) continue;
        local.multiply(new THREE.Matrix4().makeRotationZ(radps > 20 ? this.angles[rotor] : rotor));
        if (x > 0) this.blades[0].setMatrixAt(front++, local);
        else this.blades[1].setMatrixAt(rear++, local);
      }
      const height = ground ? flight.value(ground, step, drone) : NaN;
      if (layers.shadows && Number.isFinite(height)) {
        local.makeTranslation(pose[0], pose[1], pose[2] - height + 0.012).scale(new THREE.Vector3(1.3 * size, 1.3 * size, 1));
        this.drops.setMatrixAt(dropped++, local);
      }
      count++;
    }
    for (const mesh of bodies) mesh.count = count;
    this.discs.count = count * hubs.length;
    if (this.blades.length) [this.blades[0].count, this.blades[1].count] = [front, rear];
    this.drops.count = dropped;
    this.lights.geometry.setDrawRange(0, count);
    for (const attribute of lights) attribute.needsUpdate = true;
    for (const mesh of [...bodies, ...this.blades, this.discs, this.drops]) mesh.instanceMatrix.needsUpdate = true;
    this.trail.visible = layers.trails;
    if (layers.trails) this.updateTrails(flight, drones, step);
  }

  private updateTrails(flight: Flight, drones: number[], step: number): void {
    const positions = flight.column("position")!.values;
    const [to, tint] = [this.places.array as Float32Array, this.tints.array as Float32Array];
    const points = Math.max(Math.min(Math.floor(trailPoints / Math.max(drones.length, 1)), mostPoints), 2);
    const color = new THREE.Color();
    let at = 0;
    for (const drone of drones) {
      color.set(this.isGhost ? ghostColor : droneColor(drone));
      const first = flight.episodeStart(drone, step);
      const stride = Math.max(Math.ceil((step - first) / points), 1);
      const pose = this.poses.get(drone);
      let last = first;
      const add = (x: number, y: number, z: number, age: number): void => {
        const from = 3 * (last * flight.drones + drone);
        const numbers = [positions[from], positions[from + 1], positions[from + 2], x, y, z];
        if (!numbers.every(Number.isFinite)) return;
        const shade = 0.25 + 0.75 * age;
        for (let i = 0; i < 6; i++) to[at + i] = numbers[i];
        for (let i = 0; i < 6; i += 3) [tint[at + i], tint[at + i + 1], tint[at + i + 2]] = [color.r * shade, color.g * shade, color.b * shade];
        at += 6;
      };
      for (let next = first + stride; next <= step; next += stride) {
        const i = 3 * (next * flight.drones + drone);
        add(positions[i], positions[i + 1], positions[i + 2], (next - first) / Math.max(step - first, 1));
        last = next;
      }
      if (pose && step > first) add(pose[0], pose[1], pose[2], 1);
    }
    this.places.needsUpdate = this.tints.needsUpdate = true;
    this.trail.geometry.instanceCount = at / 6;
  }
}
