// The live page: bodies streamed by the server, and one hand for all of them. After drawing.js.

const RED = [0.8, 0.25, 0.2, 1];
const UNITS = { displacement: "mm", strain: "", stress: "kPa" };
const FACTORS = { displacement: 1e3, strain: 1, stress: 1e-3 };
const QUANTITIES = { displacement: "displacement", strain: "equivalent strain", stress: "von Mises stress" };
const HINTS = { push: "Drag in the picture: the tool follows. Wheel, W and S: away from you and towards you.",
  drag: "Take hold of the surface in the picture and pull it by a spring.",
  turn: "Drag turns the view, with Shift moves it; the wheel zooms." };

const $ = (id) => document.getElementById(id);
// A colour of the page's style, as text or as parts of 1.
const styled = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const parts = (colour) => [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16) / 255);
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

class Touch extends Stage {
  constructor(root, scene, send) {
    super(root, { points: unpack(scene.points, Float32Array), facets: unpack(scene.facets, Uint32Array),
      radius: scene.radius, axis: scene.axis, inclusions: scene.inclusions });
    this.send = send;
    this.tool = this.solid(unpack(scene.tool.points, Float32Array), unpack(scene.tool.facets, Uint32Array));
    const s = 0.035 * scene.radius;
    this.anchor = this.solid(Float32Array.from([s, 0, 0, -s, 0, 0, 0, s, 0, 0, -s, 0, 0, 0, s, 0, 0, -s]),
      Uint32Array.from([0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5]));
    this.ghost = this.solid(this.points, this.facets);
    this.caster = capsuleAbout(this.tool.points);
    this.gl.uniform1f(this.uniform.gloss, 0.12);
    this.colours = scene.colours;
    this.yaw += 0.3;
    this.pitch = Math.min(this.pitch + 0.15, Math.PI / 2 - 0.5);
    this.headroom = 24;
    this.mode = "push";
    this.number = 0;
    this.asked = new Map();
    this.listen();
  }

  // What the server says of the case, before the first frame.
  begin(told) {
    this.box = told.box;
    this.goal = told.tool.start;
    this.step = 0.02 * 2 * this.radius;
    if (!this.views) {
      this.makeViews(told.panes.length);
      this.makeColours(this.colours);
      for (const view of this.views) {
        const force = document.createElement("div");
        force.className = "force";
        view.querySelector(".name").after(force);
      }
    }
    this.shown = told.panes.map((name) => ({ name, mode: 1, motion: this.still, shade: new Float32Array(this.count) }));
    this.views.forEach((view, k) => { view.querySelector(".name").textContent = told.panes[k]; });
    this.measure();
    this.draw();
  }

  // Half extents of the body and the tool as first seen, and their centre.
  measure() {
    const turn = this.turn(), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const see = (points, at) => {
      for (let k = 0; k < points.length; k += 3)
        for (let row = 0; row < 2; ++row) {
          let x = 0;
          for (let i = 0; i < 3; ++i) x += turn[3 * i + row] * (points[k + i] + at[i]);
          low[row] = Math.min(low[row], x);
          high[row] = Math.max(high[row], x);
        }
    };
    see(this.points, [0, 0, 0]);
    see(this.tool.points, this.goal);
    this.half = [0, 1].map((row) => Math.max(0.5 * (high[row] - low[row]), 0.05 * this.radius));
    this.middle = [0, 1].map((row) => 0.5 * (high[row] + low[row]));
  }

  // A frame of the server's: head, then 16 bits a coordinate and 8 bits of shade for each pane.
  take(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    let begin = 4 + length;
    const { origin, step } = this.box;
    for (const shown of this.shown) {
      const numbers = new Uint16Array(buffer, begin, 3 * this.count);
      begin += numbers.byteLength;
      const motion = new Float32Array(3 * this.count);
      shown.moved = 0;
      for (let k = 0; k < motion.length; ++k) {
        motion[k] = origin[k % 3] + step * numbers[k] - this.points[k];
        shown.moved = Math.max(shown.moved, Math.abs(motion[k]));
      }
      shown.motion = motion;
      shown.ghost = Float32Array.from({ length: this.count }, (_, k) => Math.hypot(...motion.subarray(3 * k, 3 * k + 3)) / (shown.moved || 1));
    }
    this.errors = head.paused ? this.errors : null;
    for (const shown of this.shown) {
      const bytes = new Uint8Array(buffer, begin, this.count);
      begin += bytes.byteLength;
      shown.shade = Float32Array.from(bytes, (x) => x / 255);
      // What rests is grey: the dark end of the colours hides its form.
      shown.rests = bytes.every((x) => x === 0);
      shown.mode = shown.rests ? 0 : 1;
    }
    this.toolAt = head.tool;
    // Of several frames before a picture each may have an answer.
    if (head.latency !== null) this.answer = { number: head.answered, latency: head.latency };
    this.head = head;
    this.draw();
    return head;
  }

  // Errors that were judged, until the bodies go on.
  judged(note) {
    this.errors = note.errors.length ? note : null;
    if (this.errors) note.errors.forEach((text, k) => {
      // Errors are those of the surface; points of inclusions follow it in all arrays.
      this.shown[k].error = text && new Float32Array(this.count);
      if (text) this.shown[k].error.set(unpack(text, Float32Array).map((x) => x / (note.largest || 1)));
      this.shown[k].mode = text || !this.shown[k].rests ? 1 : 0;
    });
    this.draw();
  }

  stateOf(shown) { return { motion: shown.motion, shade: this.errors && shown.error ? shown.error : shown.shade, fraction: 1, lineFraction: 1 }; }

  paintBody(shown) {
    const gl = this.gl, { middle, way, radius } = this.caster;
    if (this.toolAt) {
      gl.uniform3f(this.uniform.caster, ...this.seen(add(this.toolAt, middle)));
      gl.uniform3f(this.uniform.casterWay, ...this.seen(way));
    }
    gl.uniform1f(this.uniform.casterRadius, this.toolAt ? radius : 0);
    super.paintBody(shown);
    gl.uniform1f(this.uniform.casterRadius, 0);
  }

  // A vector by right, up and towards the eye.
  seen(vector) { return this.axes().map((axis) => axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2]); }

  // The tool, where the anchor of a grip is, and what the body was at rest, in every view.
  drawBeside(shown) {
    if (!this.toolAt) return;
    this.drawSolid(this.tool, this.tool.points.map((x, k) => x + this.toolAt[k % 3]), [...this.steel, 1]);
    const held = this.head.grip && this.grip ? 3 * this.grip.point : -1;
    if (held >= 0) this.drawSolid(this.anchor, this.anchor.points.map((x, k) => x + this.points[held + k % 3] + this.head.grip[k % 3]), RED);
    if (shown.moved > 0.01 * this.radius) {
      const gl = this.gl;
      gl.enable(gl.POLYGON_OFFSET_FILL); // behind the body where that is where it was
      gl.polygonOffset(2, 4);
      this.drawSolid({ ...this.ghost, plain: shown.ghost }, this.points, [...this.steel, 0.5], 3);
      gl.disable(gl.POLYGON_OFFSET_FILL);
    }
    this.fill("rest", this.points);
  }

  paint() {
    if (!this.half) return;
    super.paint();
    if (this.head && this.head.frame !== this.painted) {
      this.painted = this.head.frame;
      this.onPaint?.(this.head);
    }
  }

  // ---------------------------------------------------------------- the hand

  // Rows of the camera: right, up, towards the eye.
  axes() {
    const t = this.turn();
    return [0, 1, 2].map((row) => [t[row], t[3 + row], t[6 + row]]);
  }

  moveHand(right, up, towards) {
    const [r, u, e] = this.axes();
    const moved = (from) => add(add(add(from, r, right), u, up), e, towards);
    if (this.grip) this.grip.by = moved(this.grip.by);
    else this.goal = moved(this.goal);
    this.sendHand();
  }

  sendHand() {
    if (this.waitingHand) return;
    this.waitingHand = true;
    requestAnimationFrame(() => {
      this.waitingHand = false;
      this.number += 1;
      const exact = (place) => place.map((x) => Math.round(x * 1e6) / 1e6);
      this.asked.set(this.number, performance.now());
      this.send(this.grip ? { kind: "pull", number: this.number, by: exact(this.grip.by) }
        : { kind: "tool", number: this.number, to: exact(this.goal) });
    });
  }

  // The point of the surface under the pointer that is nearest to the eye, or nothing.
  pick(clientX, clientY) {
    const { columns, w, h, pixels, dense, centre } = this.layout, box = this.canvas.getBoundingClientRect();
    const px = (clientX - box.left) * dense, py = (clientY - box.top) * dense;
    const column = Math.floor(px / w), row = Math.floor(py / h), shown = this.shown[row * columns + column];
    if (!shown) return null;
    const x = centre[0] + (px - (column + 0.5) * w) / pixels, y = centre[1] - (py - (row + 0.5) * h) / pixels;
    const [r, u, e] = this.axes(), seen = new Float32Array(3 * this.count);
    for (let k = 0; k < seen.length; k += 3) {
      const at = [0, 1, 2].map((i) => this.points[k + i] + shown.motion[k + i]);
      [r, u, e].forEach((axis, i) => { seen[k + i] = at[0] * axis[0] + at[1] * axis[1] + at[2] * axis[2]; });
    }
    let best = null, nearest = -Infinity;
    for (let f = 0; f < this.facets.length; f += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => 3 * this.facets[f + k]);
      const side = (p, q) => (seen[q] - seen[p]) * (y - seen[p + 1]) - (seen[q + 1] - seen[p + 1]) * (x - seen[p]);
      const [s, t, v] = [side(a, b), side(b, c), side(c, a)];
      if ((s < 0 || t < 0 || v < 0) && (s > 0 || t > 0 || v > 0)) continue;
      const depth = (seen[a + 2] + seen[b + 2] + seen[c + 2]) / 3;
      if (depth <= nearest) continue;
      nearest = depth;
      best = [a, b, c].reduce((p, q) => (Math.hypot(seen[q] - x, seen[q + 1] - y) < Math.hypot(seen[p] - x, seen[p + 1] - y) ? q : p)) / 3;
    }
    return best;
  }

  grab(clientX, clientY) {
    const point = this.pick(clientX, clientY);
    if (point === null) return;
    this.grip = { point, by: [0, 0, 0] };
    this.send({ kind: "grab", point, radius: Number($("patch").value) });
  }

  release() {
    if (!this.grip) return;
    this.grip = null;
    this.send({ kind: "let_go" });
  }

  letGo() {
    this.grip = null;
    this.goal = [...this.start ?? this.goal];
    this.send({ kind: "withdraw" });
  }

  setMode(mode) {
    this.mode = mode;
    this.canvas.classList.toggle("turning", mode === "turn");
    for (const name of ["push", "drag", "turn"]) $(`mode-${name}`).setAttribute("aria-pressed", String(name === mode));
    $("hint").textContent = HINTS[mode];
  }

  listen() {
    const canvas = this.canvas;
    let last = null, turns = false;
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("pointerdown", (e) => {
      last = [e.clientX, e.clientY];
      turns = this.mode === "turn" || e.button === 2;
      if (this.mode === "drag" && !turns) this.grab(e.clientX, e.clientY);
      canvas.setPointerCapture(e.pointerId);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => {
      last = null;
      if (!$("keep").checked) this.release();
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) return;
      const dx = e.clientX - last[0], dy = e.clientY - last[1];
      last = [e.clientX, e.clientY];
      if (this.mode === "drag" && !turns && !this.grip) return;
      if (turns) { if (e.shiftKey) this.move(dx, dy); else this.rotate(dx * 0.01, dy * 0.01); return; }
      const unit = this.layout.dense / this.layout.pixels;
      this.moveHand(dx * unit, -dy * unit, 0);
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      if (this.mode === "turn" || e.ctrlKey) this.zoomBy(Math.exp(-e.deltaY * 0.001));
      else this.moveHand(0, 0, e.deltaY * 0.001 * this.radius);
    }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const s = e.shiftKey ? 0.25 * this.step : this.step, turning = this.mode === "turn";
      const by = (right, up) => (turning ? this.rotate(0.1 * right, -0.1 * up) : this.moveHand(s * right, s * up, 0));
      const act = { ArrowLeft: () => by(-1, 0), ArrowRight: () => by(1, 0), ArrowUp: () => by(0, 1), ArrowDown: () => by(0, -1),
        w: () => this.moveHand(0, 0, -s), s: () => this.moveHand(0, 0, s), W: () => this.moveHand(0, 0, -s), S: () => this.moveHand(0, 0, s),
        "+": () => this.zoomBy(1.15), "-": () => this.zoomBy(1 / 1.15) }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }
}

// A capsule about points: along the longest side of their box, as thick as the other two are wide.
function capsuleAbout(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  points.forEach((x, k) => { low[k % 3] = Math.min(low[k % 3], x); high[k % 3] = Math.max(high[k % 3], x); });
  const sides = high.map((x, k) => x - low[k]), long = sides.indexOf(Math.max(...sides));
  const radius = 0.25 * (sides[0] + sides[1] + sides[2] - sides[long]), half = Math.max(0, 0.5 * sides[long] - radius);
  const middle = low.map((x, k) => 0.5 * (x + high[k]) - (k === long ? half : 0));
  return { radius, middle, way: [0, 1, 2].map((k) => (k === long ? 2 * half : 0)) };
}

// Force over the last ten seconds of the bodies' time, a line for each pane.
// The next of 1, 2, 4, 6, 8 times a power of ten.
function roundUp(value) {
  const size = 10 ** Math.floor(Math.log10(value));
  return size * [1, 2, 4, 6, 8, 10].find((part) => part * size >= value * (1 - 1e-9));
}

class Chart {
  constructor(canvas) { this.canvas = canvas; this.rows = []; }

  add(time, forces) {
    if (this.rows.length && time < this.rows[this.rows.length - 1].time) this.rows = [];
    this.rows.push({ time, forces });
    while (this.rows[0].time < time - 10) this.rows.shift();
  }

  paint() {
    const c = this.canvas, dense = window.devicePixelRatio || 1, g = c.getContext("2d");
    c.width = c.clientWidth * dense; c.height = c.clientHeight * dense;
    if (!this.rows.length) return;
    const last = this.rows[this.rows.length - 1].time, most = roundUp(Math.max(1e-3, ...this.rows.flatMap((r) => r.forces)));
    // Numbers stand beside the lines, not on them.
    const left = 44 * dense, right = 4 * dense, foot = 18 * dense, top = 8 * dense, high = c.height - foot - top;
    const x = (t) => c.width - right - (last - t) / 10 * (c.width - left - right), y = (f) => top + high * (1 - f / most);
    g.font = `${11 * dense}px system-ui, sans-serif`;
    g.lineWidth = dense;
    g.strokeStyle = styled("line");
    g.fillStyle = styled("soft");
    for (const part of [0, 0.5, 1]) {
      g.beginPath();
      g.moveTo(left, y(part * most));
      g.lineTo(c.width - right, y(part * most));
      g.stroke();
      g.textAlign = "right";
      g.fillText(`${+(part * most).toPrecision(2)}`, left - 4 * dense, y(part * most) + 4 * dense);
    }
    for (const [ago, align] of [[10, "left"], [5, "center"], [0, "right"]]) {
      g.textAlign = align;
      g.fillText(ago ? `${ago} s ago` : "now", x(last - ago), c.height - 5 * dense);
    }
    g.textAlign = "left";
    this.rows[0].forces.forEach((_, k) => {
      g.strokeStyle = styled(`hand-${k % 4}`);
      g.lineWidth = 1.5 * dense;
      g.beginPath();
      this.rows.forEach((r, i) => (i ? g.lineTo(x(r.time), y(r.forces[k])) : g.moveTo(x(r.time), y(r.forces[k]))));
      g.stroke();
    });
  }
}

class Page {
  constructor() {
    const scene = JSON.parse($("scene").textContent);
    const send = (message) => { if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(message)); };
    this.send = send;
    this.stage = new Touch(document.querySelector(".touch"), scene, send);
    this.stage.onPaint = (head) => this.painted(head);
    this.chart = new Chart($("chart"));
    this.frames = [];
    this.connect();
    this.listen();
    this.stage.setMode("push");
    const scheme = matchMedia("(prefers-color-scheme: dark)"), paper = () => { Object.assign(this.stage, { ground: parts(styled("stage")), steel: parts(styled("steel")) }); this.stage.draw(); this.chart.paint(); };
    scheme.addEventListener("change", paper);
    paper();
  }

  connect() {
    const socket = this.socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[?#].*$/, "") + "socket");
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => { if (typeof data === "string") this.told(JSON.parse(data)); else if (this.stage.box) this.stage.take(data); };
    socket.onclose = ({ code, reason }) => {
      const why = code === 4009 ? `refused: ${reason}` : "the simulation has ended";
      this.status(why);
      $("warning").textContent = code === 4009 ? `${reason}: go on there, or close it and reload this page`
        : "the simulation has ended, or the connection is lost: reload this page; if that finds nothing, start palpate touch again";
      $("warning").hidden = false;
      this.stage.onPaint = null; // a frame that waits would hide it
      // Without a body the picture would be black.
      if (!this.stage.box) this.stage.canvas.style.visibility = "hidden";
      disableAll();
    };
  }

  status(text) { $("status").textContent = text; document.body.dataset.status = text; }

  told(note) {
    if (note.kind === "scene") {
      this.stage.start = note.tool.start;
      this.stage.grip = null;
      if (!$("patch").value) $("patch").value = note.patch.toPrecision(2);
      this.stage.begin(note);
      this.status("");
      $("about").textContent = `${note.cells} cells, mass damping ${digits(note.damping)} /s.`;
      $("step").textContent = `${digits(1e3 * note.time_step)} ms`;
      $("limits").textContent = `The tool follows at up to ${digits(note.speed)} mm/s: faster, and the explicit steps could not keep it out. Where a cell is pressed to less than half of its volume, or the tool parts the surface's vertices, it is stopped. ${note.notes.join(" ")}`;
      if ($("loads")) $("loads").checked = note.has_loads;
    } else if (note.kind === "judged") {
      // An answer that was not found takes nothing from the one before it.
      if (note.errors.length) this.stage.judged(note);
      $("judge").disabled = note.more;
      this.progress(null);
      // An answer that was not found stands beside its question alone.
      if (!note.question || note.rows.length) this.say(note.text);
      this.answer(note);
      if (note.errors.length) this.stage.views.forEach((view, k) => {
        view.querySelector(".name").textContent = `${this.stage.shown[k].name}: ${note.verdicts[k]} against the ${note.against}`;
        view.querySelector(".most").textContent = note.errors[k] ? `${digits(note.largest)} mm` : "no reference";
      });
      if (note.errors.length) { $("quantity").textContent = note.colour; document.body.dataset.verdicts = note.verdicts.join(" "); }
      if (!note.more) document.body.dataset.judged = note.verdicts.join(" ") || "none";
    } else if (note.kind === "progress") this.progress(note);
    else if (note.kind === "note" || note.kind === "refused") this.say(note.text, note.verdict);
  }

  // How far a judgement has come, in words and as a part of the longest wait.
  progress(note) {
    $("progress").hidden = !note;
    if (!note) return;
    $("doing").textContent = note.text;
    $("share").value = note.share;
    $("percent").textContent = `${(100 * note.share).toFixed(0)} %`;
  }

  // The answer to a question beside the buttons, for each body.
  answer(note) {
    if (!note.question) return;
    const box = document.createElement("div"), asked = document.createElement("h2");
    asked.textContent = note.question;
    box.append(asked);
    for (const { name, verdict, words } of note.rows.length ? note.rows : [{ name: "", verdict: "inconclusive", words: note.text }]) {
      const line = document.createElement("p"), what = document.createElement("b");
      line.className = verdict;
      what.textContent = name ? `${name}: ${verdict}` : "not known";
      line.append(what, ` ${words.replaceAll(" %", "\u00a0%")}`);
      box.append(line);
    }
    $("verdicts").append(box);
  }

  say(text, verdict) {
    const line = document.createElement("p");
    line.textContent = text;
    if (verdict) line.className = verdict;
    $("notes").prepend(line);
    while ($("notes").children.length > 8) $("notes").lastChild.remove();
  }

  // Once a frame is on the screen.
  painted(head) {
    const now = performance.now(), stage = this.stage;
    this.send({ kind: "shown", frame: head.frame });
    this.frames.push(now);
    while (this.frames[0] < now - 1000) this.frames.shift();
    if (stage.answer) {
      const { number: answered, latency } = stage.answer, asked = stage.asked.get(answered);
      this.serverLatency = latency;
      if (asked) this.latency = now - asked;
      for (const number of stage.asked.keys()) if (number <= answered) stage.asked.delete(number);
      stage.answer = null;
    }
    const sizes = head.panes.map((pane) => Math.hypot(...pane.force));
    this.chart.add(head.time, sizes);
    if (!(now - this.toldAt < 100)) { this.toldAt = now; this.numbers(head, sizes); }
    const troubled = head.panes.some((pane) => pane.trouble);
    $("warning").hidden = !head.held_back && !head.paused;
    $("warning").textContent = head.paused ? "paused: “go on” or the space bar" : "the tissue takes no more here: the tool is stopped";
    if (!stage.errors) stage.views.forEach((view, k) => {
      view.querySelector(".name").textContent = `${stage.shown[k].name}${head.panes[k].trouble ? ": stopped; reset to go on" : ""}`;
      view.querySelector(".name").classList.toggle("trouble", Boolean(head.panes[k].trouble));
      view.querySelector(".most").textContent = `${digits(head.most * FACTORS[head.colour])} ${UNITS[head.colour]}`.trim();
    });
    $("pause").setAttribute("aria-pressed", String(head.paused));
    $("pause").textContent = head.paused ? "go on" : "pause";
    $("record").setAttribute("aria-pressed", String(head.recording));
    $("record").textContent = head.recording ? "end the recording" : "record";
    Object.assign(document.body.dataset, { frame: head.frame, time: head.time, forces: JSON.stringify(head.panes.map((p) => p.force)), troubled });
  }

  numbers(head, sizes) {
    const rows = $("numbers").tBodies[0].rows;
    head.panes.forEach((pane, k) => {
      rows[0].cells[k + 1].textContent = sizes[k].toFixed(3);
      rows[1].cells[k + 1].textContent = (100 * pane.volume).toFixed(2);
      rows[2].cells[k + 1].textContent = (1e3 * pane.energy).toFixed(3);
      rows[3].cells[k + 1].textContent = stageIsLinear(this.stage.shown[k].name) ? "–" : pane.det_f.toFixed(2);
      this.stage.views[k].querySelector(".force").textContent = `${sizes[k].toFixed(3)} N`;
    });
    this.chart.paint();
    $("quantity").textContent = this.stage.errors ? this.stage.errors.colour : `colour: ${QUANTITIES[head.colour]}`;
    // Before a pace is measured the factor tells it.
    const pace = head.time < 0.5 ? head.factor : head.pace, slow = pace < 0.9 && !head.paused;
    $("pace").classList.toggle("slow", slow);
    $("factor").textContent = slow ? `${pace.toFixed(2)}: slower than real time, the tool too` : head.factor.toFixed(2);
    $("time").textContent = `${head.time.toFixed(2)} s`;
    $("frames").textContent = `${this.frames.length}`;
    $("latency").textContent = this.latency === undefined ? "–" : `${this.latency.toFixed(0)} ms`;
    $("server").textContent = this.latency === undefined ? "–" : `${(1e3 * this.serverLatency).toFixed(0)} ms`;
  }

  listen() {
    const stage = this.stage, send = this.send;
    $("mode-push").onclick = () => stage.setMode("push");
    $("mode-drag").onclick = () => stage.setMode("drag");
    $("keep").onchange = () => { if (!$("keep").checked) stage.release(); };
    $("mode-turn").onclick = () => stage.setMode("turn");
    this.whileHeld($("deeper"), () => stage.moveHand(0, 0, -0.25 * stage.step));
    this.whileHeld($("nearer"), () => stage.moveHand(0, 0, 0.25 * stage.step));
    $("withdraw").onclick = () => stage.letGo();
    $("pause").onclick = () => send({ kind: "pause", on: $("pause").getAttribute("aria-pressed") !== "true" });
    $("reset").onclick = () => this.reset();
    $("colour").onchange = () => send({ kind: "colour", by: $("colour").value });
    if ($("loads")) $("loads").onchange = () => send({ kind: "loads", on: $("loads").checked });
    $("record").onclick = () => {
      const on = $("record").getAttribute("aria-pressed") !== "true";
      if (on) { stage.goal = [...stage.start]; stage.grip = null; }
      send({ kind: "record", on });
    };
    $("judge").onclick = () => { $("judge").disabled = true; $("verdicts").replaceChildren(); delete document.body.dataset.judged; delete document.body.dataset.verdicts; send({ kind: "judge" }); };
    document.addEventListener("keydown", (e) => {
      if (e.target instanceof HTMLSelectElement || e.target instanceof HTMLInputElement) return;
      const act = { 1: () => stage.setMode("push"), 2: () => stage.setMode("drag"), 3: () => stage.setMode("turn"),
        h: () => { $("keep").checked = !$("keep").checked; $("keep").onchange(); }, r: () => this.reset(), Escape: () => stage.letGo() }[e.key]
        ?? (e.key === " " && !(e.target instanceof HTMLButtonElement) ? () => $("pause").click() : null);
      if (act && !e.ctrlKey && !e.metaKey) { e.preventDefault(); act(); }
    });
  }

  reset() {
    $("verdicts").replaceChildren();
    $("judge").disabled = false;
    this.progress(null);
    this.stage.grip = null;
    this.stage.goal = [...this.stage.start];
    this.send({ kind: "reset" });
  }

  whileHeld(button, act) {
    let timer = 0;
    const stop = () => { clearInterval(timer); timer = 0; };
    button.addEventListener("pointerdown", () => { act(); timer = timer || setInterval(act, 16); });
    for (const name of ["pointerup", "pointerleave", "pointercancel"]) button.addEventListener(name, stop);
    button.addEventListener("keydown", (e) => { if (e.key === "Enter" || e.key === " ") act(); });
  }
}

function disableAll() { document.querySelectorAll("aside button, aside select, aside input").forEach((control) => { control.disabled = true; }); }

const stageIsLinear = (name) => name.startsWith("linear");

try {
  window.palpate = new Page();
} catch (error) {
  $("status").textContent = `This page needs WebGL 2: ${error.message}`;
  $("warning").textContent = "This page needs WebGL 2: switch on the browser's graphics acceleration, or take another browser";
  $("warning").hidden = false;
  disableAll();
  document.body.dataset.status = "failed";
}
