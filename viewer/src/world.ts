// A world in the scene: its meshes without the roof, what stands between the viewer and a drone, markers, light.

import * as THREE from "three";
import { parts, type Part } from "./glb";
import type { WorldInfo } from "./flight";
import { Gates } from "./gates";

/** What hides the followed drone is left out: fragments within a cone from the viewer to it. One set for all materials. */
export const peephole = {
  focus: { value: new THREE.Vector3() }, // the drone in the viewer's frame
  radius: { value: 0 }, // m at the drone; 0: off
};

/** Leaves out roofs, above a height that each world sets. */
const roof = new THREE.Plane(new THREE.Vector3(0, 0, -1), 1e9);

const markerColors = { start: 0xff5d52, waypoint: 0xf2c94c, goal: 0x4fd67b };

function addPeephole(material: THREE.Material): void {
  material.onBeforeCompile = (shader) => {
    shader.uniforms.focus = peephole.focus;
    shader.uniforms.peephole = peephole.radius;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nuniform vec3 focus;\nuniform float peephole;")
      .replace(
        "#include <clipping_planes_fragment>",
        `#include <clipping_planes_fragment>
        if (peephole > 0.0) {
          float far = length(focus);
          float along = dot(-vViewPosition, focus) / far;
          if (along < far - 0.6 * peephole) {
            float off = length(-vViewPosition - focus * along / far) * far / max(along, 0.05);
            float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
            if (off < peephole * (0.75 + 0.5 * noise)) discard;
          }
        }`,
      );
  };
}

/** A darker, cooler colour: the page shows worlds calmly, so that drones stand out. Textures keep their contrast. */
function calm({ color, texture }: Part): THREE.Color {
  const brightness = Math.min(0.21 * color.r + 0.72 * color.g + 0.07 * color.b, 1);
  const factor = texture ? 0.62 : (0.06 + 0.3 * brightness) / Math.max(brightness, 0.02);
  return color.clone().multiplyScalar(factor).multiply(new THREE.Color(0.94, 1, 1.1));
}

function material(part: Part): THREE.Material {
  const made = new THREE.MeshLambertMaterial({
    color: calm(part),
    emissive: part.emissive,
    map: part.texture,
    vertexColors: part.geometry.hasAttribute("color"),
    flatShading: !part.isSmooth,
    side: part.doubleSided ? THREE.DoubleSide : THREE.FrontSide,
    alphaTest: part.alphaCutoff,
    clippingPlanes: [roof],
    clipShadows: true,
  });
  addPeephole(made);
  return made;
}

export class World {
  readonly group = new THREE.Group();
  readonly bounds: THREE.Box3;
  readonly gates: Gates;

  private constructor(readonly info: WorldInfo) {
    this.bounds = new THREE.Box3(new THREE.Vector3(...info.bounds[0]), new THREE.Vector3(...info.bounds[1]));
    this.gates = new Gates(info.race_gates);
    this.group.add(this.gates.group);
  }

  static async make(info: WorldInfo): Promise<World> {
    const world = new World(info);
    for (const part of await parts(info.glb)) {
      const mesh = new THREE.Mesh(part.geometry, material(part));
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.matrixAutoUpdate = false;
      world.group.add(mesh);
      if (!part.isClosed) continue;
      const inside = new THREE.MeshBasicMaterial({ color: 0x10161e, side: THREE.BackSide, clippingPlanes: [roof] });
      world.group.add(new THREE.Mesh(part.geometry, inside));
    }
    world.addMarkers();
    return world;
  }

  /** Leaves out what is above the roof's height, or shows all. */
  useRoof(isCut: boolean): void {
    roof.constant = isCut && this.info.cut_m !== null ? this.info.cut_m : 1e9;
  }

  private addMarkers(): void {
    const { start, through, goal, marker_m: radius } = this.info;
    const places: [keyof typeof markerColors, number[]][] = through.map((place) => ["waypoint", place]);
    if (start) places.push(["start", start]);
    if (goal) places.push(["goal", goal]);
    const ball = new THREE.SphereGeometry(radius, 32, 20);
    const ring = new THREE.RingGeometry(radius * 1.25, radius * 1.4, 48);
    for (const [kind, place] of places) {
      const color = markerColors[kind];
      const inner = new THREE.Mesh(ball, new THREE.MeshLambertMaterial({ color, emissive: color, emissiveIntensity: 0.45, transparent: true, opacity: 0.8, depthWrite: false }));
      const halo = new THREE.Sprite(glow(color));
      halo.scale.setScalar(radius * 6);
      inner.position.fromArray(place);
      halo.position.fromArray(place);
      inner.name = halo.name = "marker";
      if (kind !== "start") this.group.add(inner, halo); // drones begin there
      if (kind === "waypoint") continue;
      const around = new THREE.Mesh(ring, new THREE.MeshBasicMaterial({ color, transparent: true, opacity: 0.7, side: THREE.DoubleSide, depthWrite: false }));
      around.position.fromArray(place);
      around.name = "marker";
      this.group.add(around);
    }
  }

  showMarkers(isShown: boolean): void {
    for (const child of this.group.children) if (child.name === "marker") child.visible = isShown;
  }
}

/** Removes a group, and frees what it holds on the graphics card. */
export function dispose(group: THREE.Group): void {
  group.removeFromParent();
  group.traverse((each) => {
    if (!(each instanceof THREE.Mesh)) return;
    const { geometry, material } = each as THREE.Mesh<THREE.BufferGeometry, THREE.MeshLambertMaterial>;
    geometry.dispose();
    material.map?.dispose();
    material.dispose();
  });
}

/** A soft round light around something. */
export function glow(color: THREE.ColorRepresentation): THREE.SpriteMaterial {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d")!;
  const gradient = context.createRadialGradient(32, 32, 0, 32, 32, 32);
  gradient.addColorStop(0, "rgba(255,255,255,0.5)");
  gradient.addColorStop(0.3, "rgba(255,255,255,0.14)");
  gradient.addColorStop(1, "rgba(255,255,255,0)");
  context.fillStyle = gradient;
  context.fillRect(0, 0, 64, 64);
  return new THREE.SpriteMaterial({
    map: new THREE.CanvasTexture(canvas),
    color,
    blending: THREE.AdditiveBlending,
    depthWrite: false,
    transparent: true,
  });
}

/** Sun and sky of the page. Shadows of the static world are drawn once for each world. */
export class Light {
  readonly sun = new THREE.DirectionalLight(0xfff2e0, 2.4);
  readonly group = new THREE.Group();

  constructor() {
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.bias = -0.001;
    this.sun.shadow.normalBias = 0.06;
    this.sun.shadow.radius = 2.5;
    this.group.add(this.sun, this.sun.target, new THREE.HemisphereLight(0xb8ccec, 0x4a4f5c, 1.8));
  }

  shineOn(world: World): void {
    const center = world.bounds.getCenter(new THREE.Vector3());
    const radius = world.bounds.getSize(new THREE.Vector3()).length() / 2;
    const toward = new THREE.Vector3(...world.info.sun).normalize();
    if (!(toward.z > 0.3)) toward.set(0.45, -0.35, 0.82).normalize(); // a low sun leaves a room dark
    this.sun.target.position.copy(center);
    this.sun.position.copy(center).addScaledVector(toward, 2 * radius);
    const box = this.sun.shadow.camera;
    box.left = box.bottom = -radius;
    box.right = box.top = radius;
    box.near = radius * 0.5;
    box.far = radius * 3.5;
    box.updateProjectionMatrix();
  }
}
