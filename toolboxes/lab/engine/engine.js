/* The closed loop in a page or a worker: WebAssembly modules, addressed by the catalogue's names. No dependencies. */

const PAGE = 65536; // bytes of a page of WebAssembly memory
const MOST_SAMPLES = 5e6;
const OUTCOMES = ["completed", "diverged", "left_track"];

/** Bytes of a module, from an ArrayBuffer, a view of one, or gzipped bytes in base64. */
async function bytesOf(module) {
  if (typeof module !== "string") return module;
  const packed = Uint8Array.from(atob(module), (character) => character.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(unpacked).arrayBuffer();
}

/** An instantiated module: its memory, its vectors, and space for columns behind them. */
class Instance {
  constructor(instance) {
    this.exports = instance.exports;
    this.exports._initialize?.();
    this.room = Math.ceil(this.exports.__heap_base.value / 16) * 16;
  }

  /** Float64Array of `count` numbers at an address. */
  numbers(address, count) {
    return new Float64Array(this.exports.memory.buffer, address, count);
  }

  /** Address of space for `count` numbers. */
  reserve(count) {
    const missing = this.room + 8 * count - this.exports.memory.buffer.byteLength;
    if (missing > 0) this.exports.memory.grow(Math.ceil(missing / PAGE));
    return this.room;
  }
}

export class Engine {
  /**
   * @param {object} catalogue of `dualwinch.toolboxes.lab.catalogue`
   * @param {Object<string, string|BufferSource>} modules name of a module → its bytes, or gzipped in base64
   * @returns {Promise<Engine>} modules are compiled when a structure is first run
   */
  static async load(catalogue, modules) {
    return new Engine(catalogue, modules);
  }

  constructor(catalogue, modules) {
    this.catalogue = catalogue;
    this.modules = modules;
    this.structures = Object.fromEntries(catalogue.structures.map((structure) => [structure.id, structure]));
    this.instances = {};
  }

  /** Compile a structure's module; `run` does so by itself. */
  async prepare(id) {
    const { module } = this.structure(id);
    this.instances[module] ??= bytesOf(this.modules[module])
      .then((bytes) => WebAssembly.instantiate(bytes, {}))
      .then(({ instance }) => new Instance(instance));
    return this.instances[module];
  }

  structure(id) {
    const found = this.structures[id];
    if (!found) throw new RangeError(`unknown structure '${id}': must be ${Object.keys(this.structures).join(", ")}`);
    return found;
  }

  /**
   * Run one experiment.
   *
   * @param {object} asked
   * @param {string} asked.structure id of a structure
   * @param {Object<string, ?number>} [asked.values] key → number, in place of the structure's defaults; null: an
   *   optional one is not given
   * @param {Object<string, number>} [asked.nominal] nominal `plant.*` of the controller; default: as simulated
   * @param {number|bigint|string} [asked.seed] of every random signal, below 2^64
   * @param {number} [asked.stride] samples per row kept, 1 to 1024; 0 keeps none
   * @returns {Promise<{outcome: string, until: number, t: Float64Array, columns: Object<string, Float64Array>,
   *   metrics: Object<string, number>, checks: Float64Array, seconds: number}>} metrics are NaN if the run was not
   *   completed; checks are value and limit of each of the structure's `idealised`
   */
  async run({ structure: id, values = {}, nominal = {}, seed = 0, stride = 1 }) {
    const structure = this.structure(id);
    const instance = await this.prepare(id);
    const begun = performance.now();
    const { exports } = instance;
    const all = this.values(structure, values);
    this.write(instance, structure, all, nominal);
    const samples = exports.samples();
    if (!(samples >= 1 && samples <= MOST_SAMPLES))
      throw new RangeError(`${structure.id}: ${samples} samples: must be 1 to ${MOST_SAMPLES}; change simulation.duration`);
    const width = structure.columns.length;
    const kept = stride ? Math.ceil(samples / stride) : 0;
    const room = stride ? instance.reserve(kept * width) : 0;
    const whole = BigInt(seed);
    const outcome = exports.run(Number(whole & 0xffffffffn), Number(whole >> 32n), samples, stride || 1, room);
    if (outcome < 0) throw new RangeError(`stride ${stride}: must be 0 to 1024`);
    const stepped = exports.stepped();
    const columns = {};
    const length = Math.ceil(stepped / (stride || 1));
    if (stride)
      structure.columns.forEach(({ name }, index) => {
        columns[name] = instance.numbers(room + 8 * kept * index, length).slice();
      });
    const completed = OUTCOMES[outcome] === "completed";
    const figures = instance.numbers(exports.metrics(), this.catalogue.metrics.length);
    const metrics = this.catalogue.metrics.map(({ name }, index) => [name, completed ? figures[index] : NaN]);
    return {
      outcome: OUTCOMES[outcome],
      until: stepped * all["simulation.sample_time"],
      t: columns.t ?? new Float64Array(),
      columns,
      metrics: Object.fromEntries(metrics),
      checks: instance.numbers(exports.checks(), 2 * structure.idealised.length).slice(),
      seconds: (performance.now() - begun) / 1000,
    };
  }

  /** Key → value, for all parameters of a run. */
  values(structure, given) {
    const unknown = Object.keys(given).find((key) => !structure.parameters.includes(key));
    if (unknown) throw new RangeError(`${structure.id}: unknown key '${unknown}'`);
    const defaults = structure.parameters.map((key) => [key, structure.defaults?.[key] ?? this.catalogue.keys[key].default]);
    return { ...Object.fromEntries(defaults), ...given };
  }

  /** Write a module's vector: values, the controller's nominal values, and which optional ones are given. */
  write(instance, structure, values, nominal) {
    const plant = structure.nominal.map((key) => nominal[key] ?? values[key]);
    const given = structure.optional.map((key) => (values[key] == null ? 0 : 1));
    const vector = [...structure.parameters.map((key) => Number(values[key] ?? 0)), ...plant, ...given];
    instance.numbers(instance.exports.settings(), vector.length).set(vector);
  }
}
