// Reads what World.to_glb writes: triangles, colours and textures, merged by material into few meshes.

import * as THREE from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";

interface Gltf {
  scene?: number;
  scenes: { nodes?: number[] }[];
  nodes?: GltfNode[];
  meshes?: { primitives: { attributes: Record<string, number>; indices?: number; material?: number }[] }[];
  materials?: GltfMaterial[];
  accessors?: { bufferView: number; byteOffset?: number; componentType: number; count: number; type: string; normalized?: boolean }[];
  bufferViews?: { byteOffset?: number; byteLength: number; byteStride?: number }[];
  textures?: { source: number; sampler?: number }[];
  samplers?: { wrapS?: number; wrapT?: number; magFilter?: number }[];
  images?: { bufferView: number; mimeType: string }[];
}

interface GltfNode {
  mesh?: number;
  children?: number[];
  matrix?: number[];
  translation?: number[];
  rotation?: number[];
  scale?: number[];
  extras?: { flockstep?: { primitive?: string; body?: unknown }; collision_only?: boolean };
}

interface GltfMaterial {
  name?: string;
  pbrMetallicRoughness?: { baseColorFactor?: number[]; baseColorTexture?: { index: number } };
  emissiveFactor?: number[];
  extensions?: { KHR_materials_emissive_strength?: { emissiveStrength?: number } };
  alphaCutoff?: number;
  alphaMode?: string;
  doubleSided?: boolean;
}

/** Triangles of one material, in the world frame. */
export interface Part {
  geometry: THREE.BufferGeometry;
  color: THREE.Color;
  emissive: THREE.Color;
  texture: THREE.Texture | null;
  alphaCutoff: number;
  doubleSided: boolean;
  isSmooth: boolean;
  /** Of solids, whose inside is dark where a roof is left out. */
  isClosed: boolean;
}

const components: Record<string, number> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const wraps: Record<number, THREE.Wrapping> = {
  10497: THREE.RepeatWrapping,
  33648: THREE.MirroredRepeatWrapping,
  33071: THREE.ClampToEdgeWrapping,
};
/** Primitives whose sides are round. */
const round = new Set(["cylinder", "sphere", "capsule", "disc"]);
/** Primitives without an inside, or seen from there. */
const flat = new Set(["room", "plane", "disc"]);
const creaseRad = 0.7;

class Reader {
  readonly gltf: Gltf;
  private readonly body: Uint8Array;

  constructor(glb: Uint8Array) {
    const view = new DataView(glb.buffer, glb.byteOffset, glb.byteLength);
    if (view.getUint32(0, true) !== 0x46546c67) throw new Error("a world of this page is no glTF file");
    const length = view.getUint32(12, true);
    this.gltf = JSON.parse(new TextDecoder().decode(glb.subarray(20, 20 + length))) as Gltf;
    this.body = glb.subarray(Math.min(28 + length, glb.byteLength));
  }

  bytes(index: number): Uint8Array<ArrayBuffer> {
    const { byteOffset = 0, byteLength } = this.gltf.bufferViews![index];
    return this.body.slice(byteOffset, byteOffset + byteLength) as Uint8Array<ArrayBuffer>;
  }

  /** The numbers of an accessor, normalised ones from 0 to 1. */
  numbers(index: number): Float32Array | Uint32Array {
    const { bufferView, byteOffset = 0, componentType, count, type, normalized } = this.gltf.accessors![index];
    const { byteOffset: begin = 0, byteStride } = this.gltf.bufferViews![bufferView];
    const width = components[type];
    const size = { 5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4 }[componentType]!;
    const stride = byteStride ?? width * size;
    const view = new DataView(this.body.buffer, this.body.byteOffset + begin + byteOffset);
    const out = componentType === 5126 || normalized ? new Float32Array(count * width) : new Uint32Array(count * width);
    const most = normalized ? 2 ** (8 * size) - 1 : 1;
    for (let i = 0; i < count; i++)
      for (let j = 0; j < width; j++) {
        const at = i * stride + j * size;
        const number =
          componentType === 5126 ? view.getFloat32(at, true) : size === 1 ? view.getUint8(at) : size === 2 ? view.getUint16(at, true) : view.getUint32(at, true);
        out[i * width + j] = number / most;
      }
    return out;
  }

  async texture(index: number): Promise<THREE.Texture> {
    const { source, sampler } = this.gltf.textures![index];
    const { bufferView, mimeType } = this.gltf.images![source];
    const image = await createImageBitmap(new Blob([this.bytes(bufferView)], { type: mimeType }), {
      colorSpaceConversion: "none",
      premultiplyAlpha: "none",
    });
    const texture = new THREE.Texture(image);
    const { wrapS = 10497, wrapT = 10497 } = sampler === undefined ? {} : this.gltf.samplers![sampler];
    texture.wrapS = wraps[wrapS] ?? THREE.RepeatWrapping;
    texture.wrapT = wraps[wrapT] ?? THREE.RepeatWrapping;
    texture.flipY = false;
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.anisotropy = 4;
    texture.needsUpdate = true;
    return texture;
  }
}

interface Piece {
  positions: Float32Array;
  normals: Float32Array | null;
  uv: Float32Array | null;
  colors: Float32Array | null;
  matrix: THREE.Matrix4;
}

/** Returns the triangles of a glTF file, one part for each material, z up. */
export async function parts(glb: Uint8Array): Promise<Part[]> {
  const reader = new Reader(glb);
  const { gltf } = reader;
  const pieces = new Map<string, Piece[]>();
  const made = new Map<string, Omit<Piece, "matrix">>();

  const visit = (index: number, parent: THREE.Matrix4): void => {
    const node = gltf.nodes![index];
    if (node.extras?.collision_only || node.extras?.flockstep?.body) return;
    const local = new THREE.Matrix4();
    if (node.matrix) local.fromArray(node.matrix);
    else
      local.compose(
        new THREE.Vector3(...(node.translation ?? [0, 0, 0])),
        new THREE.Quaternion(...(node.rotation ?? [0, 0, 0, 1])),
        new THREE.Vector3(...(node.scale ?? [1, 1, 1])),
      );
    const matrix = new THREE.Matrix4().multiplyMatrices(parent, local);
    const primitive = node.extras?.flockstep?.primitive ?? "";
    const smooth = round.has(primitive);
    const closed = primitive !== "" && !flat.has(primitive);
    for (const [number, shape] of (node.mesh === undefined ? [] : gltf.meshes![node.mesh].primitives).entries()) {
      const key = `${shape.material ?? -1} ${smooth} ${closed}`;
      const name = `${node.mesh} ${number} ${smooth}`;
      let piece = made.get(name);
      if (!piece) made.set(name, (piece = corners(reader, shape, smooth)));
      if (!pieces.has(key)) pieces.set(key, []);
      pieces.get(key)!.push({ ...piece, matrix });
    }
    for (const child of node.children ?? []) visit(child, matrix);
  };
  const up = new THREE.Matrix4().makeRotationX(Math.PI / 2);
  up.set(1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1); // exact
  for (const root of gltf.scenes[gltf.scene ?? 0].nodes ?? []) visit(root, up);

  return Promise.all(
    [...pieces].map(async ([key, list]) => {
      const [number, smooth, closed] = key.split(" ");
      const material = gltf.materials?.[Number(number)] ?? {};
      const pbr = material.pbrMetallicRoughness ?? {};
      const glow = material.extensions?.KHR_materials_emissive_strength?.emissiveStrength ?? 1;
      const [r, g, b] = pbr.baseColorFactor ?? [1, 1, 1];
      const [er, eg, eb] = material.emissiveFactor ?? [0, 0, 0];
      return {
        geometry: merged(list),
        color: new THREE.Color(r, g, b),
        emissive: new THREE.Color(er * glow, eg * glow, eb * glow),
        texture: pbr.baseColorTexture ? await reader.texture(pbr.baseColorTexture.index) : null,
        alphaCutoff: material.alphaMode === "MASK" ? (material.alphaCutoff ?? 0.5) : 0,
        doubleSided: material.doubleSided ?? false,
        isSmooth: smooth === "true",
        isClosed: closed === "true",
      };
    }),
  );
}

/** The corners of each triangle, without an index. */
function corners(reader: Reader, shape: { attributes: Record<string, number>; indices?: number }, smooth: boolean): Omit<Piece, "matrix"> {
  const attribute = (name: string): Float32Array | null => {
    const index = shape.attributes[name];
    return index === undefined ? null : (reader.numbers(index) as Float32Array);
  };
  const position = attribute("POSITION")!;
  const order = shape.indices === undefined ? null : reader.numbers(shape.indices);
  const spread = (values: Float32Array | null, width: number, count: number): Float32Array | null => {
    if (!values || !order) return values;
    const out = new Float32Array(order.length * count);
    for (let i = 0; i < order.length; i++) for (let j = 0; j < count; j++) out[i * count + j] = values[order[i] * width + j];
    return out;
  };
  const color = attribute("COLOR_0");
  const positions = spread(position, 3, 3)!;
  let normals: Float32Array | null = null;
  if (smooth) {
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(positions, 3));
    normals = toCreasedNormals(geometry, creaseRad).getAttribute("normal").array as Float32Array;
  }
  const width = color && color.length === (4 * position.length) / 3 ? 4 : 3;
  return { positions, normals, uv: spread(attribute("TEXCOORD_0"), 2, 2), colors: spread(color, width, 3) };
}

function merged(list: Piece[]): THREE.BufferGeometry {
  const total = list.reduce((sum, piece) => sum + piece.positions.length, 0);
  const geometry = new THREE.BufferGeometry();
  const fill = (name: string, width: number, of: (piece: Piece) => Float32Array | null, none: number, turn?: (piece: Piece) => THREE.Matrix3): void => {
    if (!list.some((piece) => of(piece))) return;
    const out = new Float32Array((total / 3) * width).fill(none);
    let at = 0;
    const v = new THREE.Vector3();
    for (const piece of list) {
      const values = of(piece);
      const count = (piece.positions.length / 3) * width;
      if (values && width === 3 && (name === "position" || turn)) {
        const normal = turn?.(piece);
        for (let i = 0; i < count; i += 3) {
          v.fromArray(values, i);
          if (normal) v.applyMatrix3(normal).normalize();
          else v.applyMatrix4(piece.matrix);
          v.toArray(out, at + i);
        }
      } else if (values) out.set(values, at);
      at += count;
    }
    geometry.setAttribute(name, new THREE.BufferAttribute(out, width));
  };
  fill("position", 3, (piece) => piece.positions, 0);
  fill("normal", 3, (piece) => piece.normals, 0, (piece) => new THREE.Matrix3().getNormalMatrix(piece.matrix));
  fill("uv", 2, (piece) => piece.uv, 0);
  fill("color", 3, (piece) => piece.colors, 1);
  geometry.computeBoundingSphere();
  return geometry;
}
