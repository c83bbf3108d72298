// The 3-D view of a report: original, candidates, reference and errors. After drawing.js.

class Viewer extends Stage {
  constructor(root) {
    const scene = JSON.parse(root.querySelector("script").textContent);
    super(root, { points: unpack(scene.points, Float32Array), facets: unpack(scene.facets, Uint32Array),
      radius: scene.radius, axis: scene.axis });
    this.scene = scene;
    this.makeViews(1 + Math.max(...scene.looks.map((look) => look.views.length)));
    this.makeColours(scene.colours);
    this.marks = Float32Array.from(unpack(scene.marks, Int8Array));
    // Displacements of all stored times, one after the other; a state at rest has one.
    this.motions = scene.solutions.map((s) => Float32Array.from(unpack(s.displacement, Int16Array), (x) => x * s.step));
    this.errorLengths = scene.errors.map((e) => unpack(e.length, Float32Array));
    this.measure();
    this.slider = root.querySelector("input[type=range]");
    this.choice = root.querySelector("select");
    if (scene.times) Object.assign(this.slider, { min: 0, max: scene.times.length - 1, step: 1, value: scene.times.length - 1 });
    this.choose();
    this.listen();
    this.slider.addEventListener("input", () => this.draw());
    this.choice.addEventListener("change", () => { this.choose(); this.draw(); });
    this.draw();
  }

  // Half extents of the body in all its states as first seen, and their centre.
  measure() {
    const turn = this.turn(), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const size = 3 * this.count;
    for (const motion of [this.still, ...this.motions])
      for (let k = 0; k < motion.length; k += 3)
        for (let row = 0; row < 2; ++row) {
          let x = 0;
          for (let i = 0; i < 3; ++i) x += turn[3 * i + row] * (this.points[k % size + i] + motion[k + i]);
          low[row] = Math.min(low[row], x);
          high[row] = Math.max(high[row], x);
        }
    this.half = [0, 1].map((row) => Math.max(0.5 * (high[row] - low[row]), 0.05 * this.radius));
    this.middle = [0, 1].map((row) => 0.5 * (high[row] + low[row]));
  }

  // What the views show: the original, then states on one scale, then errors on one scale.
  choose() {
    const scene = this.scene, views = scene.looks[Number(this.choice.value)].views;
    const all = (kind, of) => Math.max(0, ...views.filter((v) => kind in v).map((v) => of[v[kind]].largest));
    const moved = all("solution", scene.solutions), wrong = all("error", scene.errors);
    this.shown = [{ name: "original: held blue, pushed red", motion: this.still, value: this.marks, mode: 0, largest: 1 }];
    for (const v of views)
      this.shown.push("solution" in v
        ? { name: scene.solutions[v.solution].name, motion: this.motions[v.solution], value: null, mode: 1, largest: moved }
        : { name: v.name, motion: this.motions[scene.errors[v.error].candidate], value: this.errorLengths[v.error], mode: 1, largest: wrong });
    this.views.forEach((view, k) => {
      const shown = this.shown[k];
      view.hidden = !shown;
      if (!shown) return;
      view.querySelector(".name").textContent = shown.name;
      view.querySelector(".scale").hidden = shown.mode === 0;
      view.querySelector(".most").textContent = `${digits(shown.largest)} mm`;
    });
  }

  // Statics: a share of the displacement. A motion: one of its stored times.
  stateOf(shown) {
    const { frame, share } = this.moment();
    const motion = shown.mode === 0 ? shown.motion : this.frameOf(shown.motion, 3, frame);
    return { motion, shade: this.shadeOf(shown, motion, share, frame), share, lineShare: shown.mode === 0 ? share : 0 };
  }

  moment() {
    const times = this.scene.times, at = Number(this.slider.value);
    return times ? { frame: at, share: 1 } : { frame: 0, share: at };
  }

  paint() {
    const { frame, share } = this.moment(), times = this.scene.times;
    this.root.querySelector("output").textContent = times ? `${times[frame].toPrecision(3)} s` : `${Math.round(100 * share)} %`;
    super.paint();
  }

  frameOf(array, width, frame) {
    return array.subarray(frame * width * this.count, (frame + 1) * width * this.count);
  }

  // Marks as they are; lengths from 0 to 1: of the displacement shown, or of an error.
  shadeOf(shown, motion, share, frame) {
    if (shown.mode === 0) return shown.value;
    const most = shown.largest || 1;
    if (shown.value) return this.frameOf(shown.value, 1, frame).map((x) => x / most);
    const out = new Float32Array(this.count);
    for (let k = 0; k < this.count; ++k) out[k] = share * Math.hypot(motion[3 * k], motion[3 * k + 1], motion[3 * k + 2]) / most;
    return out;
  }
}

for (const root of document.querySelectorAll(".viewer")) {
  try {
    new Viewer(root);
  } catch (error) {
    root.dataset.state = "failed";
    root.querySelector(".fallback").hidden = false;
    for (const part of root.querySelectorAll("canvas, .controls, .views")) part.hidden = true;
  }
}
