// The 3-D view of a report: errors, original, candidates, reference. After drawing.js.

const TOOL = [0.79, 0.54, 0.07, 0.32], PUSHED = [0.71, 0.2, 0.18, 1], HELD = [0.12, 0.35, 0.75, 0.9];
// A tool may reach beyond the body by this part of its size before the frame cuts the tool; one that
// is no larger than so many of its sizes is whole.
const BEYOND = 0.3, WHOLE = 1.5;

// An arrow of triangles from a place along a vector: a shaft of eight sides and a cone.
function arrowOf(start, vector) {
  const length = Math.hypot(...vector), d = vector.map((x) => x / length), points = [], facets = [];
  const least = d.map(Math.abs).indexOf(Math.min(...d.map(Math.abs)));
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const side = cross(d, [0, 1, 2].map((i) => (i === least ? 1 : 0))), size = Math.hypot(...side);
  const u = side.map((x) => x / size), v = cross(d, u), count = 8;
  for (const [along, wide] of [[0, 0.02], [0.7, 0.02], [0.7, 0.07], [1, 0]])
    for (let k = 0; k < count; ++k) {
      const a = 2 * Math.PI * k / count, c = wide * Math.cos(a), s = wide * Math.sin(a);
      points.push(...[0, 1, 2].map((i) => start[i] + length * (along * d[i] + c * u[i] + s * v[i])));
    }
  for (let ring = 0; ring < 3; ++ring)
    for (let k = 0; k < count; ++k) {
      const a = ring * count + k, b = ring * count + (k + 1) % count;
      facets.push(a, b, a + count, b, b + count, a + count);
    }
  return { points, facets };
}

class Viewer extends Stage {
  constructor(root) {
    const scene = JSON.parse(root.querySelector("script").textContent);
    super(root, { points: unpack(scene.points, Float32Array), facets: unpack(scene.facets, Uint32Array),
      radius: scene.radius, eye: scene.eye, inclusions: scene.inclusions });
    this.scene = scene;
    this.makeViews(Math.max(...scene.looks.map((look) => look.views.length)));
    this.makeColours(scene.colours);
    this.marks = Float32Array.from(unpack(scene.marks, Int8Array));
    // Displacements of all stored times, one after the other; a state at rest has one.
    this.motions = scene.solutions.map((s) => Float32Array.from(unpack(s.displacement, Int16Array), (x) => x * s.step));
    this.errorLengths = scene.errors.map((e) => unpack(e.length, Float32Array));
    this.makeBeside();
    this.outermost = this.extremes();
    this.measure();
    this.slider = root.querySelector("input[type=range]");
    this.choice = root.querySelector("select");
    if (scene.times) Object.assign(this.slider, { min: 0, max: scene.times.length - 1, step: 1, value: scene.times.length - 1 });
    this.choose();
    this.listen();
    const dark = matchMedia("(prefers-color-scheme: dark)"), paint = () => { this.ground = dark.matches ? [0.08, 0.094, 0.11] : [1, 1, 1]; this.draw(); };
    dark.addEventListener("change", paint);
    paint();
    this.slider.addEventListener("input", () => this.draw());
    this.choice.addEventListener("change", () => { this.choose(); this.draw(); });
  }

  // Tools, arrows of loads, and the edges of what is fixed.
  makeBeside() {
    const scene = this.scene;
    this.tools = scene.tools.map((tool) => ({ poses: unpack(tool.poses, Float32Array),
      ...this.solid(unpack(tool.points, Float32Array), unpack(tool.facets, Uint32Array)) }));
    const ends = unpack(scene.arrows, Float32Array), points = [], facets = [];
    for (let k = 0; k < ends.length; k += 6) {
      const vector = ends.slice(k + 3, k + 6);
      if (!Math.hypot(...vector)) continue;
      const arrow = arrowOf(ends.slice(k, k + 3), [...vector]), first = points.length / 3;
      points.push(...arrow.points);
      facets.push(...arrow.facets.map((row) => row + first));
    }
    this.arrows = facets.length ? this.solid(Float32Array.from(points), Uint32Array.from(facets)) : null;
    const fixed = [];
    for (let k = 0; k < this.edges.length; k += 2)
      if (this.marks[this.edges[k]] === 1 && this.marks[this.edges[k + 1]] === 1) fixed.push(this.edges[k], this.edges[k + 1]);
    this.supports = { count: fixed.length, lines: this.elements(Uint32Array.from(fixed)) };
  }

  // A tool's points at a time.
  placed(tool, frame) {
    const p = tool.points, r = tool.poses.subarray(12 * frame, 12 * frame + 12), out = new Float32Array(p.length);
    for (let k = 0; k < p.length; k += 3)
      for (let i = 0; i < 3; ++i) out[k + i] = r[3 * i] * p[k] + r[3 * i + 1] * p[k + 1] + r[3 * i + 2] * p[k + 2] + r[9 + i];
    return out;
  }

  // In every state the points that reach farthest in some direction: they tell how large it looks.
  extremes() {
    const size = 3 * this.count, ways = [], found = [];
    for (const x of [-1, 0, 1]) for (const y of [-1, 0, 1]) for (const z of [-1, 0, 1]) if (x || y || z) ways.push([x, y, z]);
    for (const motion of [this.still, ...this.motions])
      for (const way of ways) {
        let most = -Infinity, at = null;
        for (let k = 0; k < motion.length; k += 3) {
          let reach = 0;
          for (let i = 0; i < 3; ++i) reach += way[i] * (this.points[(k + i) % size] + motion[k + i]);
          if (reach > most) { most = reach; at = k; }
        }
        found.push(...[0, 1, 2].map((i) => this.points[(at + i) % size] + motion[at + i]));
      }
    if (this.arrows) found.push(...this.arrows.points);
    return found;
  }

  // Half extents of the body in all its states, with arrows and tools, as seen now, and their centre.
  measure() {
    const turn = this.turn(), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const widen = (points, least, most) => {
      for (let k = 0; k < points.length; k += 3)
        for (let row = 0; row < 2; ++row) {
          let x = 0;
          for (let i = 0; i < 3; ++i) x += turn[3 * i + row] * points[k + i];
          low[row] = Math.min(low[row], Math.max(x, least[row]));
          high[row] = Math.max(high[row], Math.min(x, most[row]));
        }
    };
    widen(this.outermost, [-Infinity, -Infinity], [Infinity, Infinity]);
    const size = Math.max(high[0] - low[0], high[1] - low[1]), first = low.map((x) => x), last = high.map((x) => x);
    for (const tool of this.tools) {
      const points = this.placed(tool, tool.poses.length / 12 - 1), sides = [0, 1, 2].map((i) => points.filter((_, k) => k % 3 === i));
      const reach = Math.max(...sides.map((side) => Math.max(...side) - Math.min(...side)));
      const beyond = size * (reach <= WHOLE * size ? 1 : BEYOND);
      widen(points, first.map((x) => x - beyond), last.map((x) => x + beyond));
    }
    this.half = [0, 1].map((row) => Math.max(0.5 * (high[row] - low[row]), 0.05 * this.radius));
    this.middle = [0, 1].map((row) => 0.5 * (high[row] + low[row]));
  }

  // Turned, the body is as large as the frame allows again: nothing is cut off.
  rotate(yaw, pitch) {
    super.rotate(yaw, pitch);
    this.measure();
  }

  drawBeside(shown) {
    const gl = this.gl, { frame } = this.moment();
    // What is fixed is outlined where it is now.
    const { motion, fraction } = this.stateOf(shown);
    this.fill("motion", motion);
    gl.uniform1f(this.uniform.fraction, fraction);
    gl.uniform1i(this.uniform.mode, 2);
    gl.uniform4f(this.uniform.plain, ...HELD);
    gl.depthFunc(gl.LEQUAL);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.supports.lines);
    gl.drawElements(gl.LINES, this.supports.count, gl.UNSIGNED_INT, 0);
    gl.depthFunc(gl.LESS);
    // Arrows stand where the loads act on the body at rest.
    if (this.arrows) this.drawSolid(this.arrows, this.arrows.points, PUSHED);
    const end = this.tools.length ? this.tools[0].poses.length / 12 - 1 : 0;
    for (const tool of this.tools) this.drawSolid(tool, this.placed(tool, shown.mode === 0 ? 0 : Math.min(frame, end)), TOOL);
    this.fill("rest", this.points);
  }

  // What the views show: the original, then states on one scale, then errors on one scale.
  choose() {
    const scene = this.scene, views = scene.looks[Number(this.choice.value)].views;
    const all = (kind, of) => Math.max(0, ...views.filter((v) => kind in v).map((v) => of[v[kind]].largest));
    const moved = all("solution", scene.solutions), wrong = all("error", scene.errors);
    const original = { name: "original: fixed blue, loaded red", motion: this.still, value: this.marks, mode: 0, largest: 1 };
    this.shown = views.map((v) => ("original" in v ? original : "solution" in v
        ? { name: scene.solutions[v.solution].name, motion: this.motions[v.solution], value: null, mode: 1, largest: moved }
        : { name: v.name, motion: this.motions[scene.errors[v.error].candidate], value: this.errorLengths[v.error], mode: 1, largest: wrong }));
    this.views.forEach((view, k) => {
      const shown = this.shown[k];
      view.hidden = !shown;
      if (!shown) return;
      view.querySelector(".name").textContent = shown.name;
      view.querySelector(".scale").hidden = shown.mode === 0;
      view.querySelector(".most").textContent = `${digits(shown.largest)} ${scene.unit}`;
    });
  }

  // Statics: a fraction of the displacement. A motion: one of its stored times.
  stateOf(shown) {
    const { frame, fraction } = this.moment();
    const motion = shown.mode === 0 ? shown.motion : this.frameOf(shown.motion, 3, frame);
    return { motion, shade: this.shadeOf(shown, motion, fraction, frame), fraction, lineFraction: shown.mode === 0 ? fraction : 0 };
  }

  moment() {
    const times = this.scene.times, at = Number(this.slider.value);
    return times ? { frame: at, fraction: 1 } : { frame: 0, fraction: at };
  }

  paint() {
    const { frame, fraction } = this.moment(), times = this.scene.times;
    this.root.querySelector("output").textContent = times ? `${times[frame].toPrecision(3)} s` : `${Math.round(100 * fraction)} %`;
    super.paint();
  }

  frameOf(array, width, frame) {
    return array.subarray(frame * width * this.count, (frame + 1) * width * this.count);
  }

  // Marks as they are; lengths from 0 to 1: of the displacement shown, or of an error.
  shadeOf(shown, motion, fraction, frame) {
    if (shown.mode === 0) return shown.value;
    const most = shown.largest || 1;
    if (shown.value) return this.frameOf(shown.value, 1, frame).map((x) => x / most);
    const out = new Float32Array(this.count);
    for (let k = 0; k < this.count; ++k) out[k] = fraction * Math.hypot(motion[3 * k], motion[3 * k + 1], motion[3 * k + 2]) / most;
    return out;
  }
}

for (const root of document.querySelectorAll(".viewer")) {
  try {
    new Viewer(root);
  } catch (error) {
    root.dataset.state = "failed";
    root.querySelector(".fallback").hidden = false;
    for (const part of root.querySelectorAll("canvas, .controls, .views, .inside")) part.hidden = true;
  }
}
