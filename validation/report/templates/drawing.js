"use strict";
// Bodies side by side under one camera, for the report's 3-D view and the live page. WebGL2 only, no
// library, nothing fetched: a page must open anywhere, offline, for years.

const VERTEX = `#version 300 es
in vec3 rest; in vec3 motion; in float value;
uniform mat3 turn; uniform vec2 zoom; uniform float fraction; uniform vec2 centre; uniform float depth;
out vec3 position; out float shade;
void main() {
  position = turn * (rest + fraction * motion);
  shade = value;
  gl_Position = vec4((position.xy - centre) * zoom, -position.z * depth, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 position; in float shade;
uniform sampler2D colours; uniform vec4 plain; uniform int mode;
uniform vec3 caster, casterWay, lamp; uniform float casterRadius, gloss;
out vec4 colour;
// 0 where the way to the lamp is free, 1 where the caster, a capsule, is in it; 0 without one.
float shadow() {
  if (casterRadius <= 0.0) return 0.0;
  vec3 w = position - caster;
  float b = dot(lamp, casterWay), c = dot(casterWay, casterWay), d = dot(lamp, w), e = dot(casterWay, w);
  float s = c > b * b ? clamp((e - b * d) / (c - b * b), 0.0, 1.0) : 0.0, t = max(0.0, s * b - d);
  if (c > 0.0) s = clamp((e + t * b) / c, 0.0, 1.0);
  return 1.0 - smoothstep(0.8, 1.05, length(w + t * lamp - s * casterWay) / casterRadius);
}
void main() {
  if (mode == 2) { colour = plain; return; }
  vec3 normal = normalize(cross(dFdx(position), dFdy(position)));
  float light = 0.55 + 0.45 * abs(dot(normal, normalize(vec3(0.25, 0.35, 1.0))));
  vec3 base = plain.rgb;
  if (mode == 1) base = texture(colours, vec2(clamp(shade, 0.0, 1.0), 0.5)).rgb;
  else if (mode == 0 && shade < -0.5) base = vec3(0.71, 0.2, 0.18);
  else if (mode == 0 && shade > 0.5) base = vec3(0.23, 0.42, 0.63);
  float shine = gloss * pow(abs(dot(normal, normalize(lamp + vec3(0.0, 0.0, 1.0)))), 20.0);
  // Of a ghost the rim is seen, and no more of it than it has moved.
  if (mode == 3) { colour = vec4(plain.rgb, plain.a * smoothstep(0.1, 0.6, shade) * (1.0 - 0.75 * abs(normal.z))); return; }
  colour = vec4((base * light + shine) * (1.0 - 0.5 * shadow()), plain.a);
}`;

// Towards the lamp that casts shadows: right, up, towards the eye.
// How much of a body covers what is inside, where one looks inside; its bar of colours is as pale.
const PALE = 0.5;

const LAMP = [-0.48, 0.64, 0.6];

function unpack(text, Kind) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; ++k) bytes[k] = raw.charCodeAt(k);
  return new Kind(bytes.buffer);
}

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(made));
  return made;
}

// Each edge of the original once, as pairs of points.
function edgesOf(facets, count) {
  const seen = new Set(), edges = [];
  for (let f = 0; f < facets.length; f += 3)
    for (let k = 0; k < 3; ++k) {
      const a = facets[f + k], b = facets[f + (k + 1) % 3], key = Math.min(a, b) * count + Math.max(a, b);
      if (!seen.has(key)) { seen.add(key); edges.push(a, b); }
    }
  return new Uint32Array(edges);
}

function digits(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-2 && size < 1e4 ? value.toPrecision(3) : value.toExponential(1);
}

// A canvas with views, one for each entry of `shown`: { name, mode, ... }. Whoever extends it sets
// `half` and `middle` (what is to be seen, as first seen) and says by `stateOf` what a view shows:
// { motion, shade, fraction, lineFraction }: how far its facets and its lines are moved.
class Stage {
  // body: points and colours of a table, facets, half of the diagonal, and of the first look the
  // eye's turn and level or the axis along which it looks.
  constructor(root, body) {
    this.root = root;
    this.canvas = root.querySelector("canvas");
    const gl = this.gl = this.canvas.getContext("webgl2", { alpha: false, antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw Error("no WebGL2");
    Object.assign(this, { points: body.points, facets: body.facets, radius: body.radius });
    this.count = this.points.length / 3;
    this.program = program(gl);
    gl.useProgram(this.program);
    this.uniform = {};
    for (const name of ["turn", "zoom", "fraction", "centre", "depth", "colours", "plain", "mode", "caster", "casterWay", "casterRadius", "lamp", "gloss"])
      this.uniform[name] = gl.getUniformLocation(this.program, name);
    this.buffers = { rest: gl.createBuffer(), motion: gl.createBuffer(), value: gl.createBuffer() };
    this.width = { rest: 3, motion: 3, value: 1 };
    this.fill("rest", this.points);
    this.indices = this.elements(this.facets);
    this.edges = edgesOf(this.facets, this.count);
    this.lines = this.elements(this.edges);
    this.still = new Float32Array(3 * this.count);
    [this.yaw, this.pitch] = body.eye ?? [[90, 0, 0][body.axis] * Math.PI / 180, body.axis === 2 ? Math.PI / 2 : 0.12];
    this.scale = 1;
    this.offset = [0, 0];
    this.shown = [];
    this.ground = [1, 1, 1];
    gl.uniform3f(this.uniform.lamp, ...LAMP);
    this.makeInside(body.inclusions);
  }

  // Inclusions, which are seen through the body where the page's box is ticked, and their legend.
  makeInside(inclusions) {
    const box = this.root.querySelector(".inside"), see = box?.querySelector("input");
    this.inside = inclusions.map(({ facets, colour, says }) => {
      const rows = unpack(facets, Uint32Array), entry = document.createElement("span"), mark = document.createElement("i");
      mark.style.background = `rgb(${colour.map((x) => Math.round(255 * x)).join(",")})`;
      entry.append(mark, says);
      box.append(entry);
      return { colour, count: rows.length, indices: this.elements(rows) };
    });
    const look = () => { this.looksInside = Boolean(see?.checked); this.root.classList.toggle("looks-inside", this.looksInside); };
    see?.addEventListener("change", () => { look(); this.draw(); });
    look();
  }

  // What else stands in a view: nothing here.
  drawBeside() {}

  solid(points, facets) {
    return { points, facets, indices: this.elements(facets), still: new Float32Array(points.length), plain: new Float32Array(points.length / 3) };
  }

  // A solid of one colour at these points; whoever is through with solids fills "rest" again.
  drawSolid({ facets, indices, still, plain }, points, colour, mode = 0) {
    const gl = this.gl, draw = () => gl.drawElements(gl.TRIANGLES, facets.length, gl.UNSIGNED_INT, 0);
    this.fill("rest", points);
    this.fill("motion", still);
    this.fill("value", plain);
    gl.uniform1i(this.uniform.mode, mode);
    gl.uniform4f(this.uniform.plain, ...colour);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    this.cover(draw, colour[3] === 1);
  }

  // Draw facets that are solid, or of which the nearest side alone shines through: first how near it
  // is, then its colour.
  cover(draw, isSolid) {
    const gl = this.gl;
    if (isSolid) { draw(); return; }
    gl.colorMask(false, false, false, false);
    draw();
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    draw();
    gl.disable(gl.BLEND);
    gl.depthFunc(gl.LESS);
  }

  fill(name, array) {
    const gl = this.gl, position = gl.getAttribLocation(this.program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(position);
    gl.vertexAttribPointer(position, this.width[name], gl.FLOAT, false, 0, 0);
  }

  elements(array) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, array, gl.STATIC_DRAW);
    return buffer;
  }

  // A name and a bar of colours for each view.
  makeViews(count) {
    this.root.querySelector(".stage").classList.toggle("many", count > 4);
    this.views = Array.from({ length: count }, () => {
      const view = document.createElement("div");
      view.className = "view";
      view.innerHTML = '<div class="name"></div><div class="scale"><span>0</span><span class="bar"></span><span class="most"></span></div>';
      return view;
    });
    this.root.querySelector(".views").append(...this.views);
  }

  makeColours(table) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    const pixels = new Uint8Array(table.flatMap((c) => [255 * c[0], 255 * c[1], 255 * c[2], 255]));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, table.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    for (const near of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, near, gl.LINEAR);
    const stops = table.map((c) => `rgb(${c.map((x) => Math.round(255 * x)).join(",")})`).join(",");
    for (const bar of this.root.querySelectorAll(".bar")) bar.style.background = `linear-gradient(to right,${stops})`;
  }

  listen() { // turn by dragging, move with Shift, zoom by the wheel
    const canvas = this.canvas;
    let last = null;
    canvas.addEventListener("pointerdown", (e) => { last = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) return;
      const dx = e.clientX - last[0], dy = e.clientY - last[1];
      last = [e.clientX, e.clientY];
      if (e.shiftKey) this.move(dx, dy); else this.rotate(dx * 0.01, dy * 0.01);
    });
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoomBy(Math.exp(-e.deltaY * 0.001)); }, { passive: false });
    canvas.addEventListener("dblclick", () => { this.scale = 1; this.offset = [0, 0]; this.draw(); });
    canvas.addEventListener("keydown", (e) => {
      const act = { ArrowLeft: () => this.rotate(-0.1, 0), ArrowRight: () => this.rotate(0.1, 0), ArrowUp: () => this.rotate(0, -0.1),
        ArrowDown: () => this.rotate(0, 0.1), "+": () => this.zoomBy(1.15), "-": () => this.zoomBy(1 / 1.15) }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  rotate(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -Math.PI / 2), Math.PI / 2);
    this.draw();
  }

  move(dx, dy) {
    const unit = 2.2 * this.half[1] / (this.scale * this.canvas.clientHeight);
    this.offset = [this.offset[0] - dx * unit, this.offset[1] + dy * unit];
    this.draw();
  }

  zoomBy(factor) {
    this.scale = Math.min(Math.max(this.scale * factor, 0.2), 50);
    this.draw();
  }

  // Rows: right, up, towards the eye; at pitch 0 the eye is level and z is up. Stored by columns.
  turn() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [cy, -sp * sy, cp * sy, sy, sp * cy, -cp * cy, 0, cp, sp];
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.paint(); });
  }

  paint() {
    const gl = this.gl, canvas = this.canvas, dense = window.devicePixelRatio || 1;
    const wide = Math.max(1, Math.round(canvas.clientWidth * dense)), high = Math.max(1, Math.round(canvas.clientHeight * dense));
    if (canvas.width !== wide || canvas.height !== high) { canvas.width = wide; canvas.height = high; }
    gl.viewport(0, 0, wide, high);
    gl.clearColor(...this.ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    // As many columns as make the body largest; each view's words lie in its lower part.
    const count = this.shown.length, words = 56 * dense, head = (this.headroom ?? 0) * dense;
    const fits = [...new Set([count, Math.ceil(count / 2), Math.ceil(count / 3), 1])].filter((columns) => columns === 1 || wide >= 150 * dense * columns).map((columns) => {
      const w = wide / columns, h = high / Math.ceil(count / columns);
      return { columns, w, h, size: Math.min(w / this.half[0], (h - words - head) / this.half[1]) };
    });
    const { columns, w, h } = fits.reduce((best, fit) => (fit.size > best.size ? fit : best));
    const rows = Math.ceil(count / columns);
    this.views.forEach((view, k) => {
      Object.assign(view.style, { left: `${100 * (k % columns) / columns}%`, width: `${100 / columns}%`,
        bottom: `${100 * (rows - 1 - Math.floor(k / columns)) / rows}%` });
    });
    const pixels = 0.46 * this.scale * Math.min(w / this.half[0], (h - words - head) / this.half[1]);
    gl.uniformMatrix3fv(this.uniform.turn, false, this.turn());
    gl.uniform2f(this.uniform.zoom, 2 * pixels / w, 2 * pixels / h);
    const centre = [this.middle[0] + this.offset[0], this.middle[1] + this.offset[1] - 0.5 * (words - head) / pixels];
    gl.uniform2f(this.uniform.centre, ...centre);
    gl.uniform1f(this.uniform.depth, 0.2 / this.radius);
    // Where things are on the screen, for whoever points at them.
    this.layout = { columns, rows, w, h, pixels, dense, centre };
    this.shown.forEach((shown, k) => {
      gl.viewport((k % columns) * w, (rows - 1 - Math.floor(k / columns)) * h, w, h);
      this.paintBody(shown);
      this.drawBeside(shown);
    });
    this.root.dataset.state = gl.getError() === gl.NO_ERROR ? "drawn" : "failed";
  }

  // Inclusions, moved as the body is.
  paintInside() {
    const gl = this.gl;
    gl.uniform1i(this.uniform.mode, 4);
    gl.polygonOffset(2, 2);
    for (const { colour, count, indices } of this.inside) {
      gl.uniform4f(this.uniform.plain, ...colour, 1);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
    }
  }

  // What a view shows, its facets and their edges.
  paintBody(shown) {
    const gl = this.gl, { motion, shade, fraction, lineFraction } = this.stateOf(shown);
    this.fill("motion", motion);
    this.fill("value", shade);
    gl.uniform1f(this.uniform.fraction, fraction);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.enable(gl.POLYGON_OFFSET_FILL); // lines on facets are seen, and facets on those of an inclusion
    if (this.looksInside) this.paintInside();
    gl.uniform1i(this.uniform.mode, shown.mode);
    gl.uniform4f(this.uniform.plain, 0.8, 0.81, 0.82, this.looksInside ? PALE : 1);
    gl.polygonOffset(1, 1);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices);
    this.cover(() => gl.drawElements(gl.TRIANGLES, this.facets.length, gl.UNSIGNED_INT, 0), !this.looksInside);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.uniform1f(this.uniform.fraction, lineFraction);
    gl.uniform1i(this.uniform.mode, 2);
    gl.enable(gl.BLEND);
    gl.uniform4f(this.uniform.plain, 0.1, 0.14, 0.18, shown.mode === 0 ? 0.35 : 0.16);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.lines);
    gl.drawElements(gl.LINES, this.edges.length, gl.UNSIGNED_INT, 0);
    gl.disable(gl.BLEND);
  }
}
