// A recorded flight as the page holds it. Python writes it in flockstep/viewer/packing.py, which says what each name means.

export type Numbers = Float32Array | Int32Array | Uint16Array | Int16Array | Uint8Array;

export interface Column {
  name: string;
  shape: number[];
  values: Numbers;
  /** value = offset + scale * number; a number equal to `none` stands for one that is missing. */
  scale: number;
  offset: number;
  none: number | null;
}

export interface WorldInfo {
  name: string;
  glb: Uint8Array;
  /** Height in m above which roofs are left out, or null. */
  cut_m: number | null;
  start: number[] | null;
  through: number[][];
  goal: number[] | null;
  marker_m: number;
  bounds: number[][];
  sun: number[];
}

export interface Curves {
  title: string;
  unit: string;
  array: string;
  columns: string[];
}

export interface LidarInfo {
  name: string;
  ranges: string;
  directions: string;
  offset_m: number[];
  reach_m: number;
}

export interface CameraInfo {
  name: string;
  frames: string;
  data: string;
  offset_m: number[];
  quat_wxyz: number[];
  /** Tangents of half the fields of view, horizontal and vertical. */
  tangents: number[];
}

export interface BodyInfo {
  env: number;
  body: number;
  name: string;
  glb: Uint8Array;
}

export interface EpisodeEnd {
  step: number;
  row: number;
  reason: string;
  success: boolean;
  reward: number;
  steps: number;
}

interface Header {
  format: number;
  title: string;
  step_s: number;
  steps: number;
  envs: number;
  per_env: number;
  rows: number;
  worlds: (Omit<WorldInfo, "glb"> & { glb: [number, number] })[];
  bodies: (Omit<BodyInfo, "glb"> & { glb: [number, number] })[];
  drone: { name: string; glb: [number, number]; hull?: [number, number]; spins: number[]; hubs: number[][]; rotor_m: number };
  scanners: LidarInfo[];
  cameras: CameraInfo[];
  curves: Curves[];
  ends: EpisodeEnd[];
  paths?: number[][][];
  arrays: { name: string; dtype: string; shape: number[]; at: number; scale: number; offset: number; none: number | null }[];
}

const kinds: Record<string, new (buffer: ArrayBuffer, at: number, length: number) => Numbers> = {
  f4: Float32Array,
  i4: Int32Array,
  u2: Uint16Array,
  i2: Int16Array,
  u1: Uint8Array,
};

/** One flight: what a page replays. Times are in seconds from its first moment; a moment has a number, the step. */
export class Flight {
  readonly title: string;
  readonly stepS: number;
  readonly steps: number;
  readonly envs: number;
  readonly perEnv: number;
  readonly rows: number;
  readonly drones: number;
  readonly worlds: WorldInfo[];
  readonly bodies: BodyInfo[];
  /** The hull is what collides; null if it is also what is shown. */
  readonly drone: Omit<Header["drone"], "glb" | "hull"> & { glb: Uint8Array; hull: Uint8Array | null };
  readonly lidars: LidarInfo[];
  readonly cameras: CameraInfo[];
  readonly curves: Curves[];
  readonly ends: EpisodeEnd[];
  /** Planned paths of points, one for each env in turn. */
  readonly paths: number[][][];
  private readonly columns = new Map<string, Column>();
  /** First step of the episode of each drone at each of its ends, ascending. */
  private readonly breaks: number[][];

  constructor(data: ArrayBuffer) {
    const size = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size))) as Header;
    if (header.format !== 1) throw new Error(`this page reads flights of format 1, not ${String(header.format)}`);
    const start = 4 + size + ((8 - ((4 + size) % 8)) % 8);
    const bytes = ([at, length]: [number, number]): Uint8Array => new Uint8Array(data, start + at, length);
    this.title = header.title;
    this.stepS = header.step_s;
    this.steps = header.steps;
    this.envs = header.envs;
    this.perEnv = header.per_env;
    this.rows = header.rows;
    this.drones = this.envs * this.perEnv;
    this.worlds = header.worlds.map((world) => ({ ...world, glb: bytes(world.glb) }));
    this.bodies = header.bodies.map((body) => ({ ...body, glb: bytes(body.glb) }));
    const { glb, hull } = header.drone;
    this.drone = { ...header.drone, glb: bytes(glb), hull: hull && hull[0] !== glb[0] ? bytes(hull) : null };
    this.lidars = header.scanners;
    this.cameras = header.cameras;
    this.curves = header.curves;
    this.ends = header.ends;
    this.paths = header.paths ?? [];
    for (const { dtype, at, ...column } of header.arrays) {
      const length = column.shape.reduce((product, side) => product * side, 1);
      const Kind = kinds[dtype];
      if (!Kind) throw new Error(`unknown type ${dtype} of ${column.name}`);
      this.columns.set(column.name, { ...column, values: new Kind(data, start + at, length) });
    }
    this.breaks = Array.from({ length: this.drones }, () => []);
    const counts = this.column("episode");
    if (counts)
      for (let drone = 0; drone < this.drones; drone++)
        for (let step = 1; step < this.steps; step++)
          if (counts.values[step * this.drones + drone] !== counts.values[(step - 1) * this.drones + drone])
            this.breaks[drone].push(step);
  }

  get seconds(): number {
    return Math.max(this.steps - 1, 0) * this.stepS;
  }

  /** Number of the step at or before a time. */
  stepAt(seconds: number): number {
    const step = Math.floor(seconds / this.stepS + 1e-6);
    return Math.min(Math.max(step, 0), this.steps - 1);
  }

  column(name: string): Column | undefined {
    return this.columns.get(name);
  }

  /** One number of a column: its row `index` at a step, NaN where it is missing. */
  value(column: Column, step: number, index: number): number {
    const number = column.values[(step * column.values.length) / column.shape[0] + index];
    return number === column.none ? NaN : column.offset + column.scale * number;
  }

  envOf(drone: number): number {
    return Math.floor(drone / this.perEnv);
  }

  /** Row of rewards and actions of a drone: its own, or its env's. */
  rowOf(drone: number): number {
    return this.rows === this.drones ? drone : this.envOf(drone);
  }

  worldOf(env: number, step: number): number {
    const column = this.column("world_index");
    const world = column ? column.values[step * this.envs + env] : 0;
    return world < this.worlds.length ? world : 0;
  }

  /** First step of the episode that a drone flies at a step. */
  episodeStart(drone: number, step: number): number {
    const breaks = this.breaks[drone];
    let [low, high] = [0, breaks.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (breaks[middle] <= step) low = middle + 1;
      else high = middle;
    }
    return low === 0 ? 0 : breaks[low - 1];
  }

  isActive(drone: number, step: number): boolean {
    const column = this.column("active");
    return !column || column.values[step * this.drones + drone] !== 0;
  }

  /** Writes position (x, y, z) and quaternion (x, y, z, w) between two steps; false if the pose is not finite. */
  pose(drone: number, seconds: number, out: Float64Array): boolean {
    const step = this.stepAt(seconds);
    const next = Math.min(step + 1, this.steps - 1);
    const joined = this.episodeStart(drone, next) <= step;
    const [p, q] = [this.column("position")!.values, this.column("quat_wxyz")!.values];
    const isPose = (at: number): boolean => p.subarray(3 * at, 3 * at + 3).every(Number.isFinite) && q.subarray(4 * at, 4 * at + 4).some((part) => part !== 0);
    const a = step * this.drones + drone;
    if (!isPose(a)) return false;
    const follows = joined && isPose(next * this.drones + drone);
    const b = follows ? next * this.drones + drone : a;
    const part = follows ? Math.min(Math.max(seconds / this.stepS - step, 0), 1) : 0;
    for (let axis = 0; axis < 3; axis++) out[axis] = p[3 * a + axis] + part * (p[3 * b + axis] - p[3 * a + axis]);
    let dot = 0;
    for (let axis = 0; axis < 4; axis++) dot += q[4 * a + axis] * q[4 * b + axis];
    const sign = dot < 0 ? -part : part;
    let norm = 0;
    for (let axis = 0; axis < 4; axis++) {
      const turned = q[4 * a + axis] * (1 - part) + q[4 * b + axis] * sign;
      out[3 + ((axis + 3) % 4)] = turned;
      norm += turned * turned;
    }
    norm = Math.sqrt(norm);
    for (let axis = 3; axis < 7; axis++) out[axis] /= norm;
    return true;
  }

  /** The end of the episode that a row flies at a step, if it has one. */
  endOf(row: number, step: number): EpisodeEnd | undefined {
    return this.ends.find((end) => end.row === row && end.step >= step);
  }
}

/** Reads a flight out of the text of a page: base64 of gzip. */
export async function unpack(text: string): Promise<Flight> {
  const binary = atob(text.trim());
  const packed = new Uint8Array(binary.length);
  for (let at = 0; at < binary.length; at++) packed[at] = binary.charCodeAt(at);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Flight(await new Response(stream).arrayBuffer());
}
