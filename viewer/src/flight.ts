// A recorded flight as the page holds it. Python writes it in flockstep/viewer/packing.py, which says what each name means.

export type Numbers = Float64Array | Float32Array | Int32Array | Uint16Array | Int16Array | Uint8Array;

export interface Column {
  name: string;
  shape: number[];
  values: Numbers;
  /** value = offset + scale * number; a number equal to `none` stands for one that is missing. */
  scale: number;
  offset: number;
  none: number | null;
  /** Of a flight that grows: a longer array, in which `values` are the first numbers. */
  room?: Numbers;
}

/** A gate is passed along its own x axis, and z is up. */
export interface Gate {
  shape: "square" | "ring";
  center: number[];
  quat_wxyz: number[];
  /** Inside width or diameter, and thickness of the frame. */
  size_m: number;
  bar_m: number;
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
  race_gates: Gate[];
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
  /** Array of the angles in deg by which beams are turned, about an axis for each drone or for all of them. */
  turn?: string;
  turn_axes?: number[][];
}

export interface CameraInfo {
  name: string;
  frames: string;
  offset_m: number[];
  quat_wxyz: number[];
  /** Tangents of half the fields of view, horizontal and vertical. */
  tangents: number[];
}

/** The look of a moving object. */
export interface BodyInfo {
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

/** An airframe file: what a flight model needs of it. */
export interface Airframe {
  hull_m: number[][];
  mass_kg: number;
  inertia_kgm2: number[];
  rotors?: {
    position_m: number[][];
    spin: string[];
    thrust_n: number[];
    max_speed_radps: number;
    min_speed_radps: number;
    torque_ratio_m: number;
    lag_up_s: number;
    lag_down_s: number;
    inertia_kgm2: number;
    drag_n_per_radps_mps: number[];
    lift_n_per_mps2: number;
  };
  drag: { linear_n_per_mps: number[]; quadratic_n_per_mps2: number[] };
}

/** The drones of a flight; the hull is what collides, null if it is also what is shown. */
export interface DroneInfo {
  name: string;
  glb: Uint8Array;
  hull: Uint8Array | null;
  spins: number[];
  hubs: number[][];
  rotor_m: number;
  model: Airframe;
  /** Greatest commanded rates about x, y and z, degrees per second. */
  most_dps: number[];
}

/** Where a file of the flight is. */
export type Place = [begin: number, length: number];

interface Header {
  format: number;
  /** True if the moments are added to an earlier flight, which has all worlds and bodies before the first of these. */
  goes_on: boolean;
  first_world: number;
  first_body: number;
  title: string;
  steps: number;
  envs: number;
  per_env: number;
  rows: number;
  worlds: (Omit<WorldInfo, "glb"> & { glb: Place })[];
  bodies: (Omit<BodyInfo, "glb"> & { glb: Place })[];
  drone: (Omit<DroneInfo, "glb" | "hull"> & { glb: Place; hull: Place }) | null;
  scanners: LidarInfo[];
  /** Number of the first image, where it begins, and where each image ends. */
  cameras: (CameraInfo & { first: number; data: number[] })[];
  curves: Curves[];
  ends: EpisodeEnd[];
  paths?: number[][][];
  arrays: { name: string; dtype: string; shape: number[]; at: number; scale: number; offset: number; none: number | null }[];
}

const kinds: Record<string, new (buffer: ArrayBuffer, at: number, length: number) => Numbers> = {
  f8: Float64Array,
  f4: Float32Array,
  i4: Int32Array,
  u2: Uint16Array,
  i2: Int16Array,
  u1: Uint8Array,
};

/** Size of the moments that a flight keeps, if it grows. */
const mostBytes = 1 << 27;

/** Adds numbers behind those of a column. */
function extend(column: Column, more: Column): void {
  const [used, size] = [column.values.length, column.values.length + more.values.length];
  if (!column.room || column.room.length < size) {
    column.room = new (column.values.constructor as new (length: number) => Numbers)(2 * size);
    column.room.set(column.values);
  }
  const ratio = more.scale / column.scale;
  column.room.set(ratio === 1 ? more.values : more.values.map((number) => (number === more.none ? number : Math.min(Math.round(number * ratio), 65534))), used);
  column.values = column.room.subarray(0, size);
  column.shape[0] += more.shape[0];
}

/** One flight: what a page replays. Times are in seconds from its first moment; a moment has a number, the step. */
export class Flight {
  readonly title: string;
  /** Its name beside another flight. */
  label = "";
  readonly goesOn: boolean;
  private readonly firstWorld: number;
  private readonly firstBody: number;
  steps: number;
  /** A flight that grows keeps as many of its last moments as come in ten minutes, and fewer if they are large. */
  mostMoments = 18_000;
  readonly envs: number;
  readonly perEnv: number;
  readonly rows: number;
  readonly drones: number;
  readonly worlds: WorldInfo[];
  readonly bodies: BodyInfo[];
  readonly drone: DroneInfo;
  readonly lidars: LidarInfo[];
  readonly cameras: CameraInfo[];
  readonly curves: Curves[];
  ends: EpisodeEnd[];
  /** Planned paths of points, one for each env in turn. */
  readonly paths: number[][][];
  private columns: Map<string, Column>;
  private images: { first: number; files: Uint8Array[] }[];
  /** First step of the episode of each drone at each of its ends, ascending. */
  private breaks: number[][];

  /** Reads what Python has packed. */
  static read(data: ArrayBuffer): Flight {
    const size = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, size))) as Header;
    if (header.format !== 3) throw new Error(`this page reads flights of format 3, not ${String(header.format)}`);
    const start = 4 + size + ((8 - ((4 + size) % 8)) % 8);
    const columns = header.arrays.map(({ dtype, at, ...column }): Column => {
      const length = column.shape.reduce((product, side) => product * side, 1);
      const Kind = kinds[dtype];
      if (!Kind) throw new Error(`unknown type ${dtype} of ${column.name}`);
      return { ...column, values: new Kind(data, start + at, length) };
    });
    return new Flight(header, columns, ([at, length]) => new Uint8Array(data, start + at, length));
  }

  constructor(header: Omit<Header, "format" | "arrays">, columns: Column[], bytes: (place: Place) => Uint8Array) {
    this.title = header.title;
    this.goesOn = header.goes_on;
    [this.firstWorld, this.firstBody] = [header.first_world, header.first_body];
    this.steps = header.steps;
    this.envs = header.envs;
    this.perEnv = header.per_env;
    this.rows = header.rows;
    this.drones = this.envs * this.perEnv;
    this.worlds = header.worlds.map((world) => ({ ...world, glb: bytes(world.glb) }));
    this.bodies = header.bodies.map((body) => ({ ...body, glb: bytes(body.glb) }));
    const { drone } = header;
    const hull = drone && drone.hull[0] !== drone.glb[0] ? bytes(drone.hull) : null;
    this.drone = drone ? { ...drone, glb: bytes(drone.glb), hull } : ({} as DroneInfo); // the earlier flight has it
    this.lidars = header.scanners;
    this.cameras = header.cameras;
    this.images = header.cameras.map(({ first, data: [begin, ...ends] }) => ({ first, files: ends.map((end, i) => bytes([i ? ends[i - 1] : begin, end - (i ? ends[i - 1] : begin)])) }));
    this.curves = header.curves;
    this.ends = header.ends;
    this.paths = header.paths ?? [];
    this.columns = new Map(columns.map((column) => [column.name, column]));
    this.breaks = Array.from({ length: this.drones }, () => []);
    this.findBreaks(1);
  }

  private findBreaks(first: number): void {
    const counts = this.column("episode");
    if (counts)
      for (let drone = 0; drone < this.drones; drone++)
        for (let step = first; step < this.steps; step++)
          if (counts.values[step * this.drones + drone] !== counts.values[(step - 1) * this.drones + drone])
            this.breaks[drone].push(step);
  }

  /** Adds the moments of a newer flight, or replaces all by them. Returns the seconds that were forgotten at the begin. */
  add(next: Flight): number {
    this.worlds.splice(next.firstWorld, Infinity, ...next.worlds);
    this.bodies.splice(next.firstBody, Infinity, ...next.bodies);
    if (!next.goesOn) {
      ({ steps: this.steps, ends: this.ends, columns: this.columns, images: this.images, breaks: this.breaks } = next);
      return 0;
    }
    for (const column of next.columns.values()) {
      const own = this.columns.get(column.name);
      if (own) extend(own, column);
    }
    for (const [i, { files }] of next.images.entries()) this.images[i].files.push(...files);
    for (const end of next.ends) this.ends.push({ ...end, step: end.step + this.steps });
    this.steps += next.steps;
    this.findBreaks(this.steps - next.steps);
    return this.forget();
  }

  private forget(): number {
    const moments = [...this.columns.values()].filter((column) => !this.lidars.some(({ directions }) => directions === column.name));
    const bytes = moments.reduce((sum, column) => sum + column.values.byteLength, 0);
    const most = Math.max(Math.min(this.mostMoments, Math.floor((mostBytes * this.steps) / bytes)), 2);
    if (this.steps < 1.25 * most) return 0; // not at each moment: everything moves
    const drop = this.steps - most;
    const gone = this.timeAt(drop);
    for (const column of moments) {
      const width = column.values.length / column.shape[0];
      column.values.copyWithin(0, drop * width);
      column.values = column.values.subarray(0, column.values.length - drop * width);
      column.shape[0] -= drop;
    }
    this.steps = most;
    const times = this.column("time_s")!.values;
    for (let step = 0; step < most; step++) times[step] -= gone;
    this.breaks = this.breaks.map((steps) => steps.map((step) => step - drop).filter((step) => step > 0));
    this.ends = this.ends.map((end) => ({ ...end, step: end.step - drop })).filter((end) => end.step >= 0);
    for (const [i, images] of this.images.entries()) {
      const shown = this.column(this.cameras[i].frames)!.values.subarray(0, this.drones).filter((index) => index >= 0);
      const first = shown.length === this.drones ? Math.min(...shown) : images.first;
      images.files.splice(0, first - images.first);
      images.first = first;
    }
    return gone;
  }

  get seconds(): number {
    return this.timeAt(this.steps - 1);
  }

  /** Seconds of a step, or of the nearest that exists. */
  timeAt(step: number): number {
    return this.column("time_s")!.values[Math.min(Math.max(step, 0), this.steps - 1)] ?? 0;
  }

  /** Number of the step at or before a time. */
  stepAt(seconds: number): number {
    let [low, high] = [0, this.steps];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.timeAt(middle) <= seconds + 1e-6) low = middle + 1;
      else high = middle;
    }
    return Math.max(low - 1, 0);
  }

  /** Share of the time from a step to the next that has passed, from 0 to 1. */
  partOf(step: number, seconds: number): number {
    const [begin, end] = [this.timeAt(step), this.timeAt(step + 1)];
    return end > begin ? Math.min(Math.max((seconds - begin) / (end - begin), 0), 1) : 0;
  }

  /** An image of a camera as JPEG, by its number in the camera's column. */
  jpeg(camera: CameraInfo, index: number): Uint8Array | undefined {
    const { first, files } = this.images[this.cameras.indexOf(camera)];
    return files[index - first];
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
    const part = follows ? this.partOf(step, seconds) : 0;
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
  return Flight.read(await new Response(stream).arrayBuffer());
}
