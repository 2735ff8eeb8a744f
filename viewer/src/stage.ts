// Draws one flight, or two: their worlds, drones and overlays, in one view or side by side.

import * as THREE from "three";
import { Drones } from "./drones";
import { Overlays, type Layers } from "./overlays";
import type { Flight } from "./flight";
import { nextGate } from "./gates";
import { dispose, Light, peephole, World } from "./world";
import type { Viewer } from "./cameras";

export interface Choice {
  env: number;
  drone: number;
  which: "env" | "world" | "one";
  seconds: number;
  sideBySide: boolean;
  ghost: boolean;
  layers: Layers & { trails: boolean; hull: boolean; roof: boolean; markers: boolean; peephole: boolean };
}

class Part {
  readonly group = new THREE.Group();
  readonly worlds = new Map<number, World>();
  world: World | undefined;
  drone = 0;

  constructor(
    readonly flight: Flight,
    readonly drones: Drones,
    readonly overlays: Overlays,
  ) {
    this.group.add(drones.group, overlays.group);
  }

  /** Drones to show beside the chosen one. */
  chosen({ env, which, seconds }: Choice): number[] {
    const { flight } = this;
    if (which === "one") return [this.drone];
    const step = flight.stepAt(seconds);
    const world = flight.worldOf(env, step);
    const envs = which === "env" ? [env] : Array.from({ length: flight.envs }, (_, i) => i).filter((i) => flight.worldOf(i, step) === world);
    return envs.flatMap((i) => Array.from({ length: flight.perEnv }, (_, m) => i * flight.perEnv + m));
  }
}

export class Stage {
  readonly renderer: THREE.WebGLRenderer;
  private readonly scene = new THREE.Scene();
  private readonly light = new Light();
  private readonly parts: Part[] = [];
  private making: Promise<void> | null = null;

  constructor(
    private readonly element: HTMLElement,
    private readonly viewer: Viewer,
    private readonly changed: () => void,
  ) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.localClippingEnabled = true;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.renderer.toneMappingExposure = 0.62;
    this.element.append(this.renderer.domElement);
    this.scene.add(this.light.group);
  }

  async add(flight: Flight): Promise<void> {
    const part = new Part(flight, await Drones.make(flight, this.parts.length > 0), await Overlays.make(flight));
    this.parts.push(part);
    this.scene.add(part.group);
    this.viewer.radius = Math.max(...this.parts.map(({ drones }) => drones.radius));
  }

  /** Makes what has come to a flight that grows. */
  async grow(): Promise<void> {
    for (const { overlays } of this.parts) await overlays.makeLooks();
  }

  /** The pose of the chosen drone of a flight: position, then quaternion x, y, z, w. */
  pose(part = 0): Float64Array | undefined {
    return this.parts[part]?.drones.poses.get(this.parts[part].drone);
  }

  bounds(): THREE.Box3 {
    return this.parts[0].world?.bounds ?? new THREE.Box3();
  }

  /** Makes the worlds that are to be shown, if they are not there yet; drawing goes on with those that are. */
  private async prepare(choice: Choice): Promise<void> {
    for (const part of this.parts) {
      const env = Math.min(choice.env, part.flight.envs - 1);
      const index = part.flight.worldOf(env, part.flight.stepAt(choice.seconds));
      const info = part.flight.worlds[index];
      let world = part.worlds.get(index);
      if (world?.info !== info) {
        if (world) dispose(world.group);
        world = await World.make(info);
        part.worlds.set(index, world);
      }
      if (part.world === world) continue;
      if (part.world) part.group.remove(part.world.group);
      part.world = world;
      part.group.add(world.group);
      this.shineOn(this.parts[0]);
    }
  }

  private shineOn({ world }: Part): void {
    if (world) this.light.shineOn(world);
    this.renderer.shadowMap.needsUpdate = true;
  }

  isReady(choice: Choice): boolean {
    return this.parts.every((part) => {
      const env = Math.min(choice.env, part.flight.envs - 1);
      return part.world?.info === part.flight.worlds[part.flight.worldOf(env, part.flight.stepAt(choice.seconds))];
    });
  }

  async makeReady(choice: Choice): Promise<void> {
    if (this.isReady(choice)) return;
    this.making ??= this.prepare(choice).finally(() => {
      this.making = null;
      this.changed();
    });
    await this.making;
  }

  resize(): void {
    const { clientWidth: width, clientHeight: height } = this.element;
    this.renderer.setSize(width, height, false);
    for (const { drones, overlays } of this.parts) {
      drones.setResolution(width, height);
      overlays.setResolution(width, height);
    }
  }

  /** Places everything; returns how many drones are shown. */
  update(choice: Choice): number {
    let shown = 0;
    for (const [i, part] of this.parts.entries()) {
      part.drone = Math.min(choice.drone, part.flight.drones - 1);
      const env = part.flight.envOf(part.drone);
      const seconds = Math.min(choice.seconds, part.flight.seconds);
      const drones = part.chosen({ ...choice, env, seconds });
      const hidden = this.viewer.mode === "eye" ? part.drone : null;
      part.drones.update({ flight: part.flight, drones, seconds, hidden }, { trails: choice.layers.trails, shadows: true, hull: choice.layers.hull });
      part.overlays.update(part.drone, env, seconds, part.drones, choice.layers);
      part.world?.showMarkers(choice.layers.markers);
      part.world?.gates.show(nextGate(part.flight, part.drone, part.flight.stepAt(seconds)));
      if (i === 0) shown = part.drones.poses.size;
    }
    return shown;
  }

  private setRoof(choice: Choice, part: Part): void {
    part.world?.useRoof(!choice.layers.roof && this.viewer.mode !== "eye");
  }

  private drawPart(part: Part, choice: Choice): void {
    const pose = part.drones.poses.get(part.drone);
    const { camera, mode } = this.viewer;
    camera.updateMatrixWorld();
    peephole.radius.value = 0;
    if (pose && choice.layers.peephole && (mode === "orbit" || mode === "follow")) {
      peephole.focus.value.set(pose[0], pose[1], pose[2]).applyMatrix4(camera.matrixWorldInverse);
      peephole.radius.value = Math.min(Math.max(0.09 * peephole.focus.value.length(), 0.5), 2.5);
    }
    this.setRoof(choice, part);
    this.renderer.render(this.scene, camera);
  }

  draw(choice: Choice): void {
    const { clientWidth: width, clientHeight: height } = this.element;
    const [first, second] = this.parts;
    const isSplit = choice.sideBySide && !!second;
    const isEye = this.viewer.mode === "eye";
    this.setRoof(choice, first);
    this.renderer.setScissorTest(isSplit);
    first.group.visible = true;
    if (second) {
      second.group.visible = isSplit || choice.ghost;
      if (second.world) second.world.group.visible = isSplit;
    }
    if (!isSplit) {
      this.viewer.resize(width, height);
      this.renderer.setViewport(0, 0, width, height);
      this.drawPart(first, choice);
      return;
    }
    this.viewer.resize(width / 2, height);
    const isElsewhere = first.world?.info.name !== second.world?.info.name; // each half has its own shadows
    const before = { position: this.viewer.camera.position.clone(), target: this.viewer.controls.target.clone() };
    for (const [i, part] of [first, second].entries()) {
      first.group.visible = i === 0;
      second.group.visible = i === 1;
      this.renderer.setViewport((i * width) / 2, 0, width / 2, height);
      this.renderer.setScissor((i * width) / 2, 0, width / 2, height);
      const [here, there] = [this.pose(0), this.pose(1)];
      if (i === 1 && here && there && this.viewer.mode !== "free" && !isEye) {
        // The second view keeps the first one's distance and direction, around its own drone.
        const by = new THREE.Vector3(there[0] - here[0], there[1] - here[1], there[2] - here[2]);
        this.viewer.camera.position.add(by);
      } else if (i === 1 && isEye) this.viewer.update(there, 0, true);
      if (isElsewhere) this.shineOn(part);
      this.drawPart(part, choice);
    }
    if (isElsewhere) this.shineOn(first);
    this.viewer.camera.position.copy(before.position);
    if (isEye) this.viewer.update(this.pose(0), 0, true);
  }
}
