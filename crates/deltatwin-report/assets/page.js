// Curves of a page: unpacks the signals in it and draws them with uPlot. Texts are set as text only, never as HTML.
"use strict";
var deltatwin = (() => {
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  // Time over which curves are averaged on request, s.
  const AVERAGE = 0.02;

  function element(parent, tag, attributes = {}, text) {
    const e = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    if (text !== undefined) e.textContent = text;
    parent.append(e);
    return e;
  }

  const digits = x => x === null || x === undefined || !isFinite(x) ? "–"
    : x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(2) : String(+x.toPrecision(4));

  // ---- the data ------------------------------------------------------------------------------------------------------

  async function inflate(text) {
    const binary = atob(text.trim());
    const bytes = new Uint8Array(binary.length);
    for (let k = 0; k < bytes.length; k++) bytes[k] = binary.charCodeAt(k);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // Differences of zigzag numbers of sixteen bits in two byte planes, see `signals/pack.rs`.
  function series(bytes, n, place) {
    const values = new Int16Array(n);
    for (let k = 0; k < n; k++) {
      const z = bytes[place.at + k] | bytes[place.at + n + k] << 8;
      values[k] = (z >>> 1) ^ -(z & 1);
    }
    for (let pass = 0; pass < place.order; pass++) for (let k = 1; k < n; k++) values[k] += values[k - 1];
    const out = new Float32Array(n);
    for (let k = 0; k < n; k++) out[k] = values[k] * place.step;
    return out;
  }

  function times(bytes, n, place) {
    const values = new Int32Array(n);
    for (let k = 0; k < n; k++) {
      const at = place.at + k;
      values[k] = bytes[at] | bytes[at + n] << 8 | bytes[at + 2 * n] << 16 | bytes[at + 3 * n] << 24;
    }
    for (let pass = 0; pass < 2; pass++) for (let k = 1; k < n; k++) values[k] = (values[k] + values[k - 1]) | 0;
    const out = new Float64Array(n);
    for (let k = 0; k < n; k++) out[k] = place.first + values[k] * place.step;
    return out;
  }

  // Smallest and largest values of 2, 4, 8, … samples: a view is drawn from the coarsest level that fills its pixels, so
  // that no peak is lost, and from the samples themselves when they are far enough apart.
  function pyramid(samples) {
    const levels = [{ low: samples, high: samples, size: 1 }];
    for (let last = levels[0]; last.low.length > 512; last = levels[levels.length - 1]) {
      const n = Math.ceil(last.low.length / 2);
      const low = new Float32Array(n), high = new Float32Array(n);
      for (let k = 0; k < n; k++) {
        const a = 2 * k, b = Math.min(a + 1, last.low.length - 1);
        low[k] = Math.min(last.low[a], last.low[b]);
        high[k] = Math.max(last.high[a], last.high[b]);
      }
      levels.push({ low, high, size: 2 * last.size });
    }
    return levels;
  }

  // Means over `width` samples around each, that do not reach across a break.
  function averaged(samples, width, breaks) {
    const n = samples.length, out = new Float32Array(n), half = width >> 1;
    const ends = [0, ...breaks, n];
    for (let e = 0; e + 1 < ends.length; e++) {
      const [a, b] = [ends[e], ends[e + 1]], sums = new Float64Array(b - a + 1);
      for (let k = a; k < b; k++) sums[k - a + 1] = sums[k - a] + samples[k];
      for (let k = a; k < b; k++) {
        const from = Math.max(a, k - half), to = Math.min(b, k + half + 1);
        out[k] = (sums[to - a] - sums[from - a]) / (to - from);
      }
    }
    return out;
  }

  function below(t, x) {
    let low = 0, high = t.length;
    while (low < high) { const m = (low + high) >> 1; if (t[m] < x) low = m + 1; else high = m; }
    return low;
  }

  // Columns for uPlot of several pyramids over a window of time.
  function view(t, breaks, pyramids, from, to, width) {
    const first = Math.max(0, below(t, from) - 1), last = Math.min(t.length - 1, below(t, to) + 1);
    const count = last - first + 1;
    let level = 0;
    while (level + 1 < pyramids[0].length && count / (1 << level) > 2 * width) level++;
    const size = 1 << level, a = Math.floor(first / size), b = Math.floor(last / size);
    const gap = new Set(breaks.map(k => Math.floor(k / size)));
    const x = [], columns = pyramids.map(() => []);
    for (let k = a; k <= b; k++) {
      if (gap.has(k)) { x.push(t[k * size]); for (const c of columns) c.push(null); }
      const end = Math.min((k + 1) * size, t.length) - 1;
      x.push(t[k * size]);
      pyramids.forEach((p, i) => columns[i].push(p[level].low[k]));
      if (size > 1 && end > k * size) {
        x.push(t[end]);
        pyramids.forEach((p, i) => columns[i].push(p[level].high[k]));
      }
    }
    return [x, ...columns];
  }

  // ---- charts --------------------------------------------------------------------------------------------------------

  const axis = (label, size) => ({
    stroke: () => css("--quiet"), grid: { stroke: () => css("--grid"), width: 1 }, ticks: { stroke: () => css("--grid"), width: 1 },
    font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", label, labelSize: label ? 18 : 0, size,
    // The three decimals of the default show small steps as equal numbers.
    values: (u, all, index, space, step) => all.map(x => x === null ? "" : step < 1e-3 ? String(+x.toPrecision(6)) : plain.format(x)),
  });
  const plain = new Intl.NumberFormat(navigator.language);

  function band(noise) {
    return u => {
      const { ctx, bbox } = u, y = v => u.valToPos(v, "y", true);
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      ctx.fillStyle = css("--band");
      for (const k of [1, 2]) ctx.fillRect(bbox.left, y(k * noise), bbox.width, y(-k * noise) - y(k * noise));
      ctx.restore();
    };
  }

  // Names of curves with their colours, given as variables of the style; and the stage of those that can be switched off.
  function keys(parent, entries) {
    const row = element(parent, "p", { class: "keys" });
    for (const [name, color, stage] of entries) {
      const key = element(row, "span", stage === undefined ? {} : { "data-stage": stage });
      element(key, "i").style.background = `var(${color})`;
      key.append(name);
    }
  }

  function chart(parent, options, data) {
    const box = element(parent, "div");
    const width = () => Math.max(240, box.clientWidth || parent.clientWidth || 600);
    const u = new uPlot({ width: width(), height: 180, legend: { show: false }, ...options }, data, box);
    return { u, box, width };
  }

  // Cursor of a chart in which a drag chooses what `view` shows, a double click everything; `key` links it with others.
  const draggable = (view, key) => ({
    sync: { key }, drag: { x: true, y: false, setScale: false }, points: { size: 5 },
    bind: { dblclick: () => () => { view.show(...view.whole); } },
  });
  const dragged = view => u => {
    if (u.select.width < 4) return;
    const [a, b] = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    view.show(a, b);
  };
  function keyboard(plot, view) {
    plot.addEventListener("keydown", e => {
      const act = { ArrowLeft: () => view.pan(-.2), ArrowRight: () => view.pan(.2), "+": () => view.zoom(.6), "=": () => view.zoom(.6), "-": () => view.zoom(1.6), "0": () => view.show(...view.whole) }[e.key];
      if (act && !e.ctrlKey && !e.metaKey) { e.preventDefault(); act(); }
    });
  }

  class Signals {
    constructor(section, header, bytes) {
      this.section = section;
      this.header = header;
      const n = header.samples;
      this.t = times(bytes, n, header.time);
      this.channels = header.channels.map(c => {
        const measured = series(bytes, n, c.measured);
        const models = c.models.map(m => series(bytes, n, m));
        const left = models.map(m => { const r = new Float32Array(n); for (let k = 0; k < n; k++) r[k] = measured[k] - m[k]; return r; });
        return { ...c, pyramids: { measured: pyramid(measured), models: models.map(pyramid), left: left.map(pyramid) } };
      });
      const steps = [];
      for (let k = 1; k < Math.min(n, 200); k++) steps.push(this.t[k] - this.t[k - 1]);
      const dt = steps.sort((a, b) => a - b)[steps.length >> 1] || 1;
      this.samples = 2 * Math.max(1, Math.round(AVERAGE / dt / 2)) + 1;
      for (const c of this.channels)
        c.pyramids.average = c.pyramids.left.map(p => pyramid(averaged(p[0].low, this.samples, header.breaks)));
      this.average = true;
      this.rates = header.rates.map(r => ({ ...r, pyramid: pyramid(series(bytes, n, r.series)) }));
      if (header.robot) this.points = header.robot.points.map(p => p.map(place => series(bytes, header.robot.poses, place)));
      this.angles = header.angles.map(a => ({ ...a, samples: series(bytes, n, a.series) }));
      this.stages = header.stages;
      // Variables of the style with the colours of the stages.
      this.colors = header.roles.map(role => `--${role}`);
      this.shown = this.stages.map(() => true);
      this.whole = [this.t[0] || 0, this.t[n - 1] || 1];
      this.window = [...this.whole];
      // The first chart shows the channel with most left, in noise floors; many channels are shown on request.
      const ratio = c => c.noise > 0 ? c.rms[Math.min(1, c.rms.length - 1)] / c.noise : 0;
      const order = this.channels.map((c, k) => k).sort((a, b) => ratio(this.channels[b]) - ratio(this.channels[a]));
      this.visible = this.channels.map((_, k) => order.indexOf(k) < 6);
      this.torques = false;
      this.asked = false;
      this.worst = order[0] || 0;
      this.charts = [];
      this.build();
    }

    // -- frame and buttons
    build() {
      const panels = this.section.querySelector(".signals-panels");
      panels.replaceChildren();
      const tools = element(panels, "div", { class: "tools", role: "toolbar", "aria-label": "curves" });
      this.stages.forEach((name, s) => {
        const b = this.toggle(tools, name, () => this.shown[s], on => { this.shown[s] = on; this.stageChanged(); });
        const i = document.createElement("i");
        i.style.background = `var(${this.colors[s]})`;
        b.prepend(i);
      });
      this.toggle(tools, `mean of ${(1e3 * AVERAGE).toFixed(0)} ms`, () => this.average, on => { this.average = on; this.rebuild(); this.robot?.draw(); this.drawPair(); });
      this.toggle(tools, "measured and model", () => this.torques, on => { this.torques = on; this.rebuild(); });
      this.toggle(tools, "what is here?", () => this.asked, on => { this.asked = on; this.here.hidden = !on; this.drawHere(); });
      const steps = element(tools, "span", { class: "steps" });
      for (const [text, label, act] of [["◀", "earlier", () => this.pan(-.25)], ["▶", "later", () => this.pan(.25)],
        ["+", "closer", () => this.zoom(.5)], ["−", "wider", () => this.zoom(2)], ["all", "whole recording", () => this.show(...this.whole)]])
        element(steps, "button", { type: "button", "aria-label": label, title: label }, text).onclick = act;
      if (this.channels.length > 1) {
        const choice = element(panels, "div", { class: "choice", role: "group", "aria-label": "channels" });
        this.channels.forEach((c, k) => this.toggle(choice, c.name, () => this.visible[k], on => { this.visible[k] = on; this.rebuild(); this.drawHere(); }));
      }
      this.over = element(panels, "div", { class: "plot overview" });
      this.here = element(panels, "div", { class: "here", role: "region", "aria-label": "what is in the chosen time", hidden: "" });
      const moving = element(panels, "div", { class: "moving" });
      this.time = element(moving, "div");
      if (this.header.robot) this.robot = new Robot(this, element(moving, "div", { class: "robot", role: "group", "aria-label": "the robot" }));
      element(panels, "p", { class: "small" },
        "Drag across a chart or the strip above to zoom all of them, double-click for the whole recording; wheel with Ctrl zooms. Keys in a chart: ← → + − 0. Grey: one and two standard deviations of the noise; of a mean, of white noise.");
      this.overview();
      this.rebuild();
      this.pairPanel(panels);
      if (this.header.places.length) this.placesPanel(panels);
      if (this.header.maps) this.mapsPanel(panels);
    }

    toggle(parent, text, get, set) {
      const b = element(parent, "button", { type: "button", "aria-pressed": get() }, text);
      b.onclick = () => { set(!get()); b.setAttribute("aria-pressed", get()); };
      return b;
    }

    // Legend of what is drawn by stages, with the noise if its band is drawn.
    keys(plot, noise) {
      keys(plot, [...this.stages.map((name, s) => [name, this.colors[s], s]), ...(noise > 0 ? [["noise, 1 and 2 std", "--band"]] : [])]);
      this.hideKeys(plot);
    }
    hideKeys(root) {
      for (const key of root.querySelectorAll("[data-stage]")) key.hidden = !this.shown[key.dataset.stage];
    }

    stageChanged() {
      this.hideKeys(this.section);
      for (const c of this.charts) if (c.stages) this.shown.forEach((on, s) => c.u.setSeries(c.stages + s, { show: on }));
      this.robot?.draw();
      this.drawPlaces?.();
      this.drawPair();
      this.drawHere();
    }

    // -- the strip with the whole recording
    overview() {
      const c = this.channels[this.worst];
      element(this.over, "h3", {}, `whole recording: residual of ${c.name}`);
      this.keys(this.over, 0);
      const colors = this.colors.map(color => () => css(color));
      const data = width => view(this.t, this.header.breaks, c.pyramids.average, ...this.whole, width);
      const made = chart(this.over, {
        height: 92, cursor: { show: false }, scales: { x: { time: false }, y: { range: symmetric } },
        axes: [axis("t / s", 26), { ...axis(undefined, 56), splits: () => [0] }],
        series: [{}, ...colors.map(stroke => ({ stroke, width: 1, points: { show: false } }))],
        hooks: { draw: [u => this.marked(u)] },
      }, data(800));
      this.strip = { ...made, data };
      const at = e => made.u.posToVal(e.clientX - made.u.over.getBoundingClientRect().left, "x");
      let from = null;
      made.u.over.addEventListener("pointerdown", e => { from = at(e); made.u.over.setPointerCapture(e.pointerId); });
      made.u.over.addEventListener("pointermove", e => { if (from !== null) this.show(Math.min(from, at(e)), Math.max(from, at(e))); });
      made.u.over.addEventListener("pointerup", e => { if (from !== null && Math.abs(at(e) - from) < 1e-3 * (this.whole[1] - this.whole[0])) this.show(...this.whole); from = null; });
    }

    marked(u) {
      const [a, b] = this.window.map(x => u.valToPos(x, "x", true)), { left, top, width, height } = u.bbox;
      if (this.window[0] <= this.whole[0] && this.window[1] >= this.whole[1]) return;
      u.ctx.save();
      u.ctx.fillStyle = css("--paper");
      u.ctx.globalAlpha = .72;
      u.ctx.fillRect(left, top, a - left, height);
      u.ctx.fillRect(b, top, left + width - b, height);
      u.ctx.globalAlpha = 1;
      u.ctx.strokeStyle = css("--text");
      u.ctx.strokeRect(a, top + 1, b - a, height - 2);
      u.ctx.restore();
    }

    // -- charts over time
    rebuild() {
      for (const c of this.charts) c.u.destroy();
      this.charts = [];
      this.time.replaceChildren();
      const n = this.stages.length;
      this.channels.forEach((c, k) => {
        if (!this.visible[k]) return;
        const plot = element(this.time, "div", { class: "plot", tabindex: "0", role: "img", "aria-label": `residual of ${c.name} over time` });
        const title = element(plot, "h3", {}, `${c.name}: measured − model`);
        const noise = this.average ? c.noise / Math.sqrt(this.samples) : c.noise;
        const mean = this.average ? `, of the mean ${digits(noise)}` : "";
        const value = element(title, "small", {}, `noise ${digits(c.noise)} ${c.unit}${mean}`);
        this.keys(plot, noise);
        const series = this.stages.map((name, s) => ({ stroke: () => css(this.colors[s]), width: 1, show: this.shown[s], points: { show: false } }));
        this.add(plot, value, c, this.average ? c.pyramids.average : c.pyramids.left, { series: [{}, ...series], hooks: noise > 0 ? { drawAxes: [band(noise)] } : {}, scales: { y: { range: symmetric } } },
          `residual / ${c.unit}`, 1);
        if (this.torques) {
          const both = element(this.time, "div", { class: "plot", tabindex: "0", role: "img", "aria-label": `${c.name}, measured and model` });
          const head = element(both, "h3", {}, `${c.name}: measured, and ${this.stages[n - 1]}`);
          keys(both, [["measured", "--measured"], [this.stages[n - 1], this.colors[n - 1]]]);
          this.add(both, element(head, "small"), c, [c.pyramids.measured, c.pyramids.models[n - 1]], {
            series: [{}, { stroke: () => css("--measured"), width: 1, points: { show: false } }, { stroke: () => css(this.colors[n - 1]), width: 1, points: { show: false } }],
          }, c.unit, 0);
        }
      });
      if (this.rates.length) {
        const plot = element(this.time, "div", { class: "plot", tabindex: "0", role: "img", "aria-label": "joint speeds over time" });
        const head = element(plot, "h3", {}, "motion: speeds of the joints");
        const palette = [1, 2, 3, 4].map(k => `--axis-${k}`);
        keys(plot, this.rates.map((r, i) => [r.name, palette[i % 4]]));
        this.add(plot, element(head, "small"), { unit: this.rates[0].unit, names: this.rates.map(r => r.name) }, this.rates.map(r => r.pyramid), {
          height: 138, series: [{}, ...this.rates.map((_, i) => ({ stroke: () => css(palette[i % 4]), width: 1, points: { show: false } }))],
        }, `speed / ${this.rates[0].unit}`, 0);
      }
    }

    add(plot, value, channel, pyramids, options, label, stages) {
      const data = width => view(this.t, this.header.breaks, pyramids, ...this.window, width);
      const still = value.textContent;
      const made = chart(plot, {
        ...options,
        scales: { x: { time: false, range: () => this.window }, ...options.scales },
        axes: [axis("t / s", 28), axis(label, 62)],
        cursor: draggable(this, "deltatwin"),
        hooks: {
          ...options.hooks,
          setSelect: [dragged(this)],
          setCursor: [u => {
            const k = u.cursor.idx;
            // The chart under the pointer tells others where it is.
            if (u.cursor.event && k !== null && k !== undefined) {
              this.robot?.show(u.data[0][k]);
              dispatchEvent(new CustomEvent("deltatwin-time", { detail: u.data[0][k] }));
            }
            value.textContent = k === null || k === undefined || !u.data[0].length ? still
              : `${digits(u.data[0][k])} s: ` + u.data.slice(1).map((y, s) => u.series[s + 1].show ? digits(y[k]) : null).filter(x => x !== null).join(" · ") + ` ${channel.unit}`;
          }],
        },
      }, data(700));
      made.u.over.addEventListener("wheel", e => {
        if (!e.ctrlKey && !e.metaKey) return;
        e.preventDefault();
        this.zoom(e.deltaY < 0 ? .8 : 1.25, made.u.posToVal(e.clientX - made.u.over.getBoundingClientRect().left, "x"));
      }, { passive: false });
      keyboard(plot, this);
      this.charts.push({ ...made, data, stages, mark: element(made.u.over, "i", { class: "moment", hidden: "" }) });
      this.place();
    }

    // Marks the moment `t`, s, in every chart, and shows the robot there.
    mark(t) { this.moment = t; this.place(); this.robot?.show(t); }
    place() {
      const t = this.moment, inside = t !== undefined && t >= this.window[0] && t <= this.window[1];
      for (const c of this.charts) {
        c.mark.hidden = !inside;
        if (inside) c.mark.style.left = `${(t - this.window[0]) / (this.window[1] - this.window[0]) * c.u.over.clientWidth}px`;
      }
    }

    // -- the window
    show(from, to) {
      const least = 8 * (this.whole[1] - this.whole[0]) / Math.max(8, this.t.length);
      if (to - from < least) { const m = (from + to) / 2; from = m - least / 2; to = m + least / 2; }
      this.window = [Math.max(from, this.whole[0]), Math.min(to, this.whole[1])];
      if (!this.pending) this.pending = requestAnimationFrame(() => { this.pending = 0; this.draw(); });
    }
    pan(share) {
      const d = this.window[1] - this.window[0];
      const a = Math.min(Math.max(this.window[0] + share * d, this.whole[0]), this.whole[1] - d);
      this.show(a, a + d);
    }
    zoom(factor, centre = (this.window[0] + this.window[1]) / 2) {
      this.show(centre - factor * (centre - this.window[0]), centre + factor * (this.window[1] - centre));
    }
    draw() {
      for (const c of [...this.charts, this.pair]) c.late = true;
      this.seen();
      this.strip.u.redraw(false);
      this.place();
      this.drawHere();
    }
    // What is far outside the screen is drawn when it comes into sight.
    seen() {
      for (const c of [...this.charts, this.pair]) {
        if (!c.late) continue;
        const r = c.box.getBoundingClientRect();
        c.late = r.bottom < -400 || r.top > innerHeight + 400;
        if (!c.late) c === this.pair ? this.drawPair() : c.u.setData(c.data(c.u.bbox.width));
      }
    }
    resize() {
      for (const c of [...this.charts, this.strip, this.pair, ...(this.small || [])]) c.u.setSize({ width: c.width(), height: c.u.height });
      this.robot?.draw();
      this.draw();
    }
    recolor() {
      for (const c of [...this.charts, this.strip, ...(this.small || [])]) c.u.redraw(false);
      this.pair.late = false;
      this.drawPair();
      this.drawMaps?.();
      this.robot?.draw();
    }

    // -- any signal over any other
    // All signals by kind; one with a curve per stage names the stages.
    signals() {
      const one = (color, samples) => [{ color, samples }];
      const staged = pyramids => pyramids.map((p, s) => ({ stage: s, color: this.colors[s], samples: p[0].low }));
      const residual = c => this.average ? c.pyramids.average : c.pyramids.left;
      const axes = (all, what) => all.map(a => ({ name: `${a.name} ${what}`, unit: a.unit, curves: one("--measured", a.samples || a.pyramid[0].low) }));
      return [
        ["time", [{ name: "time", unit: "s", curves: one("--measured", this.t) }]],
        ["residual", this.channels.map(c => ({ name: `residual of ${c.name}`, unit: c.unit, curves: staged(residual(c)) }))],
        ["angle", axes(this.angles, "angle")],
        ["speed", axes(this.rates, "speed")],
        ["measured", this.channels.map(c => ({ name: `${c.name}, measured`, unit: c.unit, curves: one("--measured", c.pyramids.measured[0].low) }))],
        ["model", this.channels.map(c => ({ name: `${c.name}, model`, unit: c.unit, curves: staged(c.pyramids.models) }))],
      ];
    }

    pairPanel(panels) {
      element(panels, "h3", {}, "Any signal over any other");
      const choice = element(panels, "div", { class: "choice", role: "group", "aria-label": "signals" });
      const groups = this.signals(), index = [];
      groups.forEach(([, all], g) => all.forEach((_, k) => index.push([g, k])));
      const select = (name, first) => {
        const own = element(element(choice, "label", {}, `${name} `), "select", { "aria-label": `signal on ${name}` });
        groups.forEach(([kind, all], g) => {
          const group = element(own, "optgroup", { label: kind });
          all.forEach((s, k) => element(group, "option", { value: index.findIndex(([a, b]) => a === g && b === k) }, s.name));
        });
        own.value = index.findIndex(([g, k]) => g === first[0] && k === first[1]);
        own.onchange = () => { labelled(); this.drawPair(); };
        return own;
      };
      // At first the worst residual over the rate of its drive.
      const drive = this.worst < this.rates.length ? this.worst : 0;
      const y = select("y", [1, this.worst]), x = select("x", this.rates.length ? [3, drive] : [0, 0]);
      let lines = false;
      this.toggle(choice, "lines", () => lines, on => { lines = on; this.drawPair(); });
      const plot = element(panels, "div", { class: "plot pair", role: "img" }), names = element(plot, "div");
      const chosen = (all, own) => { const [g, k] = index[+own.value]; return all[g][1][k]; };
      const labelled = () => plot.setAttribute("aria-label", `${chosen(groups, y).name} over ${chosen(groups, x).name}`);
      labelled();
      const range = { x: [0, 1], y: [0, 1] };
      let curves = [];
      this.pair = chart(plot, {
        height: 300, cursor: { show: false }, series: [{}, { paths: () => null, points: { show: false } }],
        scales: { x: { time: false, range: () => range.x }, y: { range: () => range.y } },
        axes: [axis(" ", 28), axis(" ", 62)],
        hooks: { draw: [u => this.drawCurves(u, curves, lines)] },
      }, [[0, 1], [0, 1]]);
      element(panels, "p", { class: "small" }, "The samples of the time chosen above; r is the correlation of the two.");
      this.drawPair = () => {
        const all = this.signals(), [a, b] = [chosen(all, x), chosen(all, y)];
        const first = below(this.t, this.window[0]), last = below(this.t, this.window[1] + 1e-9);
        const cut = c => c.samples.subarray(first, last);
        // Signals with a curve per stage are drawn stage by stage, over each other too.
        const at = (s, k) => s.curves[Math.min(k, s.curves.length - 1)];
        const longer = a.curves.length > b.curves.length ? a : b;
        curves = longer.curves.map((c, k) => ({ ...c, x: cut(at(a, k)), y: cut(at(b, k)) })).filter(c => c.stage === undefined || this.shown[c.stage]);
        [a, b].forEach((s, k) => { this.pair.u.axes[k].label = `${s.name} / ${s.unit}`; });
        range.x = ends(curves.map(c => c.x));
        range.y = ends(curves.map(c => c.y));
        names.replaceChildren();
        keys(names, curves.map(c => [`${c.stage === undefined ? b.name : this.stages[c.stage]}: r ${digits(+correlation(c.x, c.y).toFixed(3))}`, c.color]));
        this.pair.u.setData([[0, 1], [0, 1]]);
      };
      this.pair.late = true;
      this.seen();
    }

    drawCurves(u, curves, lines) {
      const { ctx, bbox } = u, dot = 1.6 * (devicePixelRatio || 1);
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      for (const c of curves) {
        const n = c.x.length, px = k => u.valToPos(c.x[k], "x", true), py = k => u.valToPos(c.y[k], "y", true);
        ctx.fillStyle = ctx.strokeStyle = css(c.color);
        ctx.globalAlpha = .65;
        ctx.lineWidth = dot / 2;
        ctx.beginPath();
        if (lines) for (let k = 0; k < n; k++) ctx.lineTo(px(k), py(k));
        else for (let k = 0; k < n; k++) ctx.rect(px(k) - dot / 2, py(k) - dot / 2, dot, dot);
        if (lines) ctx.stroke(); else ctx.fill();
      }
      ctx.restore();
    }

    // -- what is in the chosen time
    // Of every stage shown the RMS residual of every channel in the window, its ratio to the noise, and the share of the
    // squares of the whole recording that lies there; for all channels squares in units of the noise.
    drawHere() {
      if (!this.asked) return;
      this.sums ??= this.channels.map(c => c.pyramids.left.map(p => {
        const sums = new Float64Array(this.t.length + 1);
        for (let k = 0; k < this.t.length; k++) sums[k + 1] = sums[k] + p[0].low[k] ** 2;
        return sums;
      }));
      const n = this.t.length, first = below(this.t, this.window[0]), last = below(this.t, this.window[1] + 1e-9), count = last - first;
      const percent = x => isFinite(x) ? `${+(100 * x).toPrecision(3)}\u00a0%` : "–";
      const energy = (c, s, a, b) => this.sums[c][s][b] - this.sums[c][s][a];
      const shown = this.stages.map((_, s) => s).filter(s => this.shown[s]), noisy = this.channels.map((_, c) => c).filter(c => this.channels[c].noise > 0);
      const whole = (s, a, b) => noisy.reduce((sum, c) => sum + energy(c, s, a, b) / this.channels[c].noise ** 2, 0);
      this.here.replaceChildren();
      element(this.here, "p", {}, `${digits(this.window[0])} to ${digits(this.window[1])} s, ${percent(count / n)} of the samples: RMS residual and the share of the squared residual that lies here.`);
      if (!count) return;
      const wide = element(this.here, "div", { class: "wide", tabindex: "0", role: "group", "aria-label": "residuals in the chosen time" });
      const table = element(wide, "table", { class: "cards" }), head = element(element(table, "thead"), "tr"), body = element(table, "tbody");
      element(head, "th", {}, "channel");
      for (const s of shown) keys(element(head, "th"), [[this.stages[s], this.colors[s]]]);
      const row = (name, cell) => {
        const tr = element(body, "tr");
        element(tr, "th", { scope: "row" }, name);
        for (const s of shown) element(tr, "td", { "data-label": this.stages[s] }, cell(s));
      };
      if (noisy.length > 1) row("all", s => `${digits(Math.sqrt(whole(s, first, last) / count / noisy.length))} × noise, ${percent(whole(s, first, last) / whole(s, 0, n))}`);
      this.channels.forEach((c, k) => row(c.name, s => {
        const rms = Math.sqrt(energy(k, s, first, last) / count), ratio = c.noise > 0 ? ` = ${digits(+(rms / c.noise).toPrecision(3))}\u00a0×\u00a0noise` : "";
        return `${digits(+rms.toPrecision(3))} ${c.unit}${ratio}, ${percent(energy(k, s, first, last) / energy(k, s, 0, n))}`;
      }));
      if (this.header.explained) this.drawExplained();
    }

    // Share of the squares of the residual in the window that every candidate takes away, over whole bins of time; for all
    // channels squares in units of the noise.
    drawExplained() {
      const e = this.header.explained, bins = e.samples.length;
      const a = Math.min(Math.max(0, Math.floor((this.window[0] - e.first) / e.width + 1e-6)), bins - 1);
      const b = Math.min(Math.max(a + 1, Math.ceil((this.window[1] - e.first) / e.width - 1e-6)), bins);
      const sum = values => values.slice(a, b).reduce((x, y) => x + y, 0), samples = sum(e.samples);
      const noisy = this.channels.map((_, c) => c).filter(c => this.channels[c].noise > 0), total = sums => noisy.reduce((x, c) => x + sum(sums[c]), 0);
      const columns = this.channels.map((c, k) => [c.name, sums => sum(sums[k]), c.noise > 0 ? 1 : 0]).filter((_, k) => this.visible[k]);
      if (noisy.length > 1) columns.unshift(["all", total, noisy.length]);
      const share = x => isFinite(x) ? `${(Math.round(1000 * x) / 10 + 0).toFixed(1).replace("-", "−")}\u00a0%` : "–";
      const rows = e.names.map((name, k) => ({ name, refitted: e.refitted[k], shares: columns.map(([, of]) => 1 - of(e.after[k]) / of(e.before)) }));
      rows.sort((x, y) => y.refitted - x.refitted || y.shares[0] - x.shares[0]);
      element(this.here, "h3", {}, `What explains the residual from ${digits(e.first + a * e.width)} to ${digits(e.first + b * e.width)} s`);
      element(this.here, "p", { class: "small" },
        "Share of the squared residual of the identified model that disappears with each of the best candidates as the only addition; below zero it grows. Amplitudes are those of the diagnosis, from all fitted recordings, to first order. Of pure noise nothing disappears: its share is in the last row.");
      const wide = element(this.here, "div", { class: "wide", tabindex: "0", role: "group", "aria-label": "candidates in the chosen time" });
      const table = element(wide, "table", { class: "cards explained" }), head = element(element(table, "thead"), "tr"), body = element(table, "tbody");
      for (const text of ["candidate", ...columns.map(([name]) => name)]) element(head, "th", {}, text);
      const row = (name, cells) => {
        const tr = element(body, "tr"), th = element(tr, "th", { scope: "row" });
        th.append(...name);
        cells.forEach((text, k) => element(tr, "td", { "data-label": columns[k][0] }, text));
      };
      for (const { name, refitted, shares } of rows) {
        const code = document.createElement("code");
        // A long name may be broken after its underscores.
        name.split(/(?<=_)/).forEach((part, k) => code.append(...(k ? [document.createElement("wbr"), part] : [part])));
        row([code, refitted ? " added, all refitted" : ""], shares.map(share));
      }
      row(["noise"], columns.map(([, of, count]) => count ? share(Math.min(1, samples * count / of(e.before))) : "–"));
    }

    // -- over the motion and frequency
    placesPanel(panels) {
      element(panels, "h3", {}, "Over the motion and frequency");
      const choice = element(panels, "div", { class: "choice", role: "group", "aria-label": "channel" });
      const legend = element(panels, "div", { class: "plot" });
      const grid = element(panels, "div", { class: "small-plots" });
      let chosen = this.worst;
      const buttons = this.channels.map((c, k) => {
        const b = element(choice, "button", { type: "button", "aria-pressed": k === chosen }, c.name);
        b.onclick = () => { chosen = k; buttons.forEach((other, i) => other.setAttribute("aria-pressed", i === k)); this.drawPlaces(); };
        return b;
      });
      this.drawPlaces = () => {
        for (const c of this.small || []) c.u.destroy();
        this.small = [];
        grid.replaceChildren();
        legend.replaceChildren();
        this.keys(legend, this.channels[chosen].noise);
        const place = this.header.places[chosen], unit = this.channels[chosen].unit, noise = this.channels[chosen].noise;
        for (const over of place.over) {
          if (!over.x.length) continue;
          const series = [{}], data = [over.x], bands = [];
          over.stages.forEach((s, k) => {
            const at = data.length, fill = css(this.colors[k]) + "30";
            data.push(s.mean.map((m, i) => m === null ? null : m + s.std[i]), s.mean.map((m, i) => m === null ? null : m - s.std[i]), s.mean);
            series.push({ show: this.shown[k], width: 0, points: { show: false } }, { show: this.shown[k], width: 0, points: { show: false } },
              { show: this.shown[k], stroke: () => css(this.colors[k]), width: 2, points: { show: false } });
            bands.push({ series: [at, at + 1], fill });
          });
          this.smallChart(grid, over.label, `residual / ${unit}`, data, series, { bands, hooks: noise > 0 ? { drawAxes: [band(noise)] } : {}, scales: { x: { time: false }, y: { range: symmetric } } });
        }
        if (place.spectrum.x.length) {
          const lines = place.spectrum.stages.map((_, k) => ({ show: this.shown[k], stroke: () => css(this.colors[k]), width: 1.5, points: { show: false } }));
          const positive = place.spectrum.stages.map(a => a.map(v => v > 0 ? v : null));
          this.smallChart(grid, "frequency / Hz", `amplitude / ${unit}`, [place.spectrum.x, ...positive], [{}, ...lines], { scales: { x: { time: false, distr: 3, range: () => [place.spectrum.x[0], place.spectrum.x[place.spectrum.x.length - 1]] }, y: { distr: 3 } } });
        }
      };
      this.drawPlaces();
    }

    smallChart(grid, label, unit, data, series, options) {
      // Powers of ten below what a decimal fraction shows.
      const tens = options.scales.y.distr === 3 ? { values: (u, all) => all.map(x => x === null ? "" : x < 1e-3 ? x.toExponential(0) : String(x)) } : {};
      const plot = element(grid, "div", { class: "plot", role: "img", "aria-label": `residual over ${label}` });
      this.small.push(chart(plot, { height: 210, cursor: { show: false }, axes: [axis(label, 28), { ...axis(unit, 58), ...tens }], series, ...options }, data));
    }

    // -- over the workspace
    mapsPanel(panels) {
      const maps = this.header.maps.filter(m => m);
      if (!maps.length) return;
      element(panels, "h3", {}, "Over the workspace");
      const choice = element(panels, "div", { class: "choice" });
      const select = element(choice, "select", { "aria-label": "channel of the map" });
      element(select, "option", { value: 0 }, "all channels");
      this.channels.forEach((c, k) => element(select, "option", { value: k + 1 }, c.name));
      select.onchange = () => this.drawMaps();
      // Every view once per stage, next to each other.
      const canvases = maps.flatMap(m => {
        const row = element(panels, "div", { class: "maps" });
        return this.stages.map((name, stage) => {
          const figure = element(row, "figure");
          const canvas = element(figure, "canvas", { role: "img", "aria-label": `map of the residual of ${name}, ${m.name}` });
          const caption = element(figure, "figcaption", {}, `${name}, ${m.name}: ${m.axes.join("–")}`);
          return { m, stage, canvas, caption, still: caption.textContent };
        });
      });
      const legend = element(panels, "div", { class: "legend" });
      const ramp = element(legend, "canvas", { class: "legend-bar", width: 256, height: 1, "aria-hidden": "true" });
      const ends = element(legend, "span");
      const [low, high] = [element(ends, "span"), element(ends, "span")];
      this.drawMaps = () => {
        const layer = +select.value;
        // One scale for all stages, so that an improvement is seen.
        let top = 1.2;
        for (const m of maps) for (const s of m.stages) for (const v of s[layer]) if (v > top) top = v;
        for (let k = 0; k < 256; k++) { ramp.getContext("2d").fillStyle = heat(k / 255); ramp.getContext("2d").fillRect(k, 0, 1, 1); }
        low.textContent = "noise";
        high.textContent = `RMS ${digits(top)} × noise`;
        for (const { m, stage, canvas, caption, still } of canvases) {
          const px = 10, ratio = devicePixelRatio || 1, pad = 34;
          const [nx, ny] = m.size, w = nx * px + pad, h = ny * px + pad;
          canvas.width = w * ratio; canvas.height = h * ratio; canvas.style.width = w + "px";
          const ctx = canvas.getContext("2d");
          ctx.scale(ratio, ratio);
          ctx.clearRect(0, 0, w, h);
          const cells = m.stages[stage][layer];
          cells.forEach((v, k) => {
            if (v === null) return;
            ctx.fillStyle = heat((v - 1) / (top - 1));
            ctx.fillRect(pad + (k % nx) * px, (ny - 1 - Math.floor(k / nx)) * px, px - 1, px - 1);
          });
          ctx.fillStyle = css("--quiet");
          ctx.font = "11px system-ui, sans-serif";
          const end = k => digits(m.low[k] + m.size[k] * m.cell);
          ctx.fillText(`${digits(+m.low[0].toFixed(2))}`, pad, h - pad + 14);
          ctx.textAlign = "right";
          ctx.fillText(`${(+end(0)).toFixed(2)} m`, w, h - pad + 14);
          ctx.textAlign = "center";
          ctx.fillText(m.axes[0], pad + nx * px / 2, h - pad + 14);
          ctx.textAlign = "right";
          ctx.fillText((+m.low[1]).toFixed(2), pad - 3, ny * px);
          ctx.fillText((+end(1)).toFixed(2), pad - 3, 10);
          ctx.fillText(m.axes[1], pad - 3, ny * px / 2);
          canvas.onpointermove = e => {
            const r = canvas.getBoundingClientRect(), s = w / r.width;
            const cx = Math.floor(((e.clientX - r.left) * s - pad) / px), cy = ny - 1 - Math.floor((e.clientY - r.top) * s / px);
            const v = cx >= 0 && cx < nx && cy >= 0 && cy < ny ? cells[cy * nx + cx] : null;
            caption.textContent = v === null || v === undefined ? still
              : `${m.axes[0]} ${(m.low[0] + (cx + .5) * m.cell).toFixed(3)}, ${m.axes[1]} ${(m.low[1] + (cy + .5) * m.cell).toFixed(3)} m: ${digits(v)} × noise`;
          };
          canvas.onpointerleave = () => { caption.textContent = still; };
        }
      };
      this.drawMaps();
    }
  }

  // ---- the robot -----------------------------------------------------------------------------------------------------

  // Residual of a drive, in standard deviations of the noise as the charts show it, up to which its limb has a colour.
  const GRADES = [[2, "--good"], [5, "--amber"], [Infinity, "--bad"]];
  // Angle of a key press and of a dragged pixel, rad; longest time in which the chosen part is played, s.
  const TURN = Math.PI / 18, PER_PIXEL = .01, PLAYED = 20;

  // The robot at a moment of the recording, see `signals/robot.rs`; each limb in the colour of its drive's residual.
  class Robot {
    constructor(signals, box) {
      this.signals = signals;
      this.content = signals.header.robot;
      this.turned = .35;
      this.raised = .35;
      this.canvas = element(box, "canvas", { tabindex: "0", role: "img" });
      const row = element(box, "div", { class: "choice" });
      this.button = element(row, "button", { type: "button", "aria-label": "play" }, "▶");
      this.button.onclick = () => this.play(!this.playing);
      const [a, b] = signals.whole;
      this.slider = element(row, "input", { type: "range", "aria-label": "time of the robot, s", min: a, max: b, step: (b - a) / 1000 });
      this.slider.oninput = () => { this.play(false); this.signals.mark(+this.slider.value); };
      keys(box, GRADES.map(([end, color], k) => [isFinite(end) ? `to ${end} × noise` : "above", color]));
      this.values = element(box, "p", { class: "small" });
      element(box, "p", { class: "small" }, "Follows the cursor of the charts; drag or arrow keys turn it.");
      this.range();
      this.listen();
      this.show(a);
    }

    // Upright cylinder around all that is seen: middle, radius and half its height, m.
    range() {
      const ends = [...this.content.faces.flat(), ...this.content.rods.flatMap(r => r.ends)], all = [];
      for (const [point, ...offset] of ends) {
        if (point < 0) { all.push(offset); continue; }
        const p = this.signals.points[point];
        for (let k = 0; k < this.content.poses; k++) all.push(offset.map((d, i) => d + p[i][k]));
      }
      const low = [Infinity, Infinity, Infinity], high = low.map(x => -x);
      for (const p of all) p.forEach((x, i) => { low[i] = Math.min(low[i], x); high[i] = Math.max(high[i], x); });
      this.middle = low.map((x, i) => (x + high[i]) / 2);
      this.radius = all.reduce((most, p) => Math.max(most, Math.hypot(p[0] - this.middle[0], p[1] - this.middle[1])), 0);
      this.height = (high[2] - low[2]) / 2;
    }

    listen() {
      const { canvas } = this;
      let from = null;
      canvas.addEventListener("pointerdown", e => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", e => {
        if (!from) return;
        this.turn((from[0] - e.clientX) * PER_PIXEL, (e.clientY - from[1]) * PER_PIXEL);
        from = [e.clientX, e.clientY];
      });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
      canvas.addEventListener("keydown", e => {
        const by = { ArrowLeft: [TURN, 0], ArrowRight: [-TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] }[e.key];
        if (by && !e.ctrlKey && !e.metaKey && !e.altKey) { e.preventDefault(); this.turn(...by); }
      });
    }

    turn(about, up) {
      this.turned += about;
      this.raised = Math.min(Math.max(this.raised + up, -Math.PI / 2), Math.PI / 2);
      this.draw();
    }

    // Plays the chosen time, from the moment shown if it lies in there.
    play(on) {
      this.playing = on;
      this.button.textContent = on ? "❚❚" : "▶";
      this.button.setAttribute("aria-label", on ? "pause" : "play");
      let last = performance.now();
      const step = now => {
        if (!this.playing || !this.canvas.isConnected) return;
        const [a, b] = this.signals.window, next = this.t + Math.max(1, (b - a) / PLAYED) * (now - last) / 1e3;
        last = now;
        this.signals.mark(next >= a && next <= b ? next : a);
        requestAnimationFrame(step);
      };
      if (on) requestAnimationFrame(step);
    }

    // The moment `t`, s.
    show(t) {
      this.t = t;
      this.slider.value = t;
      if (!this.pending) this.pending = requestAnimationFrame(() => { this.pending = 0; this.draw(); });
    }

    // Coordinates of a point at the moment, between the poses around it unless there is a gap.
    place() {
      const { t } = this.signals, { poses, every } = this.content;
      const k = Math.min(Math.max(below(t, this.t), 0), t.length - 1), at = Math.min(Math.floor(k / every), poses - 1), next = Math.min(at + 1, poses - 1);
      const gap = next === at || this.signals.header.breaks.some(b => b > at * every && b <= next * every);
      const share = gap ? 0 : Math.min(Math.max((this.t - t[at * every]) / (t[next * every] - t[at * every]), 0), 1);
      return this.signals.points.map(p => p.map(x => x[at] + share * (x[next] - x[at])));
    }

    // Ratio of every drive's residual to the noise at the moment, of the last stage shown.
    ratios() {
      const { signals } = this, stage = signals.shown.lastIndexOf(true), k = Math.min(below(signals.t, this.t), signals.t.length - 1);
      const all = new Map();
      for (const c of signals.channels) {
        if (c.drive === null || !(c.noise > 0) || stage < 0) continue;
        const left = (signals.average ? c.pyramids.average : c.pyramids.left)[stage][0].low[k];
        all.set(c.drive, { name: c.name, ratio: Math.abs(left) / (signals.average ? c.noise / Math.sqrt(signals.samples) : c.noise) });
      }
      return all;
    }

    grade(of, ratios = this.ratios()) {
      return ratios.has(of) ? GRADES.find(([end]) => ratios.get(of).ratio <= end)[1] : "--quiet";
    }

    draw() {
      const { canvas, content } = this, ratio = devicePixelRatio || 1, w = canvas.clientWidth || 260, h = canvas.clientHeight || 260;
      canvas.width = w * ratio;
      canvas.height = h * ratio;
      const ctx = canvas.getContext("2d"), points = this.place(), ratios = this.ratios();
      ctx.scale(ratio, ratio);
      const [s, c, up, along] = [Math.sin(this.turned), Math.cos(this.turned), Math.sin(this.raised), Math.cos(this.raised)];
      const scale = Math.min((w / 2 - 6) / this.radius, (h / 2 - 6) / (along * this.height + Math.abs(up) * this.radius));
      // On the canvas x to the right, y downwards; depth grows towards the eye.
      const seen = ([point, ...offset]) => {
        const [x, y, z] = offset.map((d, k) => d + (point < 0 ? 0 : points[point][k]) - this.middle[k]);
        const right = c * x - s * y, away = s * x + c * y;
        return [w / 2 + scale * right, h / 2 - scale * (along * z + up * away), up * z - along * away];
      };
      const parts = [
        ...content.faces.map(f => ({ ends: f.map(seen), face: true })),
        ...content.rods.map(r => ({ ends: r.ends.map(seen), wide: Math.max(1.5, scale * r.wide), color: this.grade(r.of, ratios) })),
      ];
      const depth = p => p.ends.reduce((sum, e) => sum + e[2], 0) / p.ends.length;
      parts.sort((a, b) => depth(a) - depth(b));
      const [paper, quiet] = [css("--paper"), css("--quiet")];
      ctx.lineCap = ctx.lineJoin = "round";
      for (const p of parts) {
        ctx.beginPath();
        for (const e of p.ends) ctx.lineTo(e[0], e[1]);
        if (p.face) {
          ctx.closePath();
          ctx.fillStyle = ctx.strokeStyle = quiet;
          ctx.globalAlpha = .3;
          ctx.fill();
          ctx.globalAlpha = 1;
          ctx.lineWidth = 2;
          ctx.stroke();
          continue;
        }
        // An edge in the colour of the paper separates what is in front from what is behind.
        for (const [color, wide] of [[paper, p.wide + 2], [css(p.color), p.wide]]) {
          ctx.strokeStyle = color;
          ctx.lineWidth = wide;
          ctx.stroke();
        }
      }
      const told = [...ratios.values()].map(r => `${r.name} ${+r.ratio.toFixed(1)}`).join(", ");
      this.values.textContent = `${this.t.toFixed(2)} s, residual over noise: ${told || "no noise is known"}`;
      canvas.setAttribute("aria-label", `the robot at ${this.values.textContent}; arrow keys turn it`);
    }
  }

  // A colour that may be a variable of the style.
  const shade = color => color.startsWith("var(") ? css(color.slice(4, -1)) : color;

  // A figure of curves over a common abscissa, drawn to be zoomed; its picture remains for print.
  class Curves {
    constructor(figure, content) {
      this.section = figure;
      this.content = content;
      this.hidden = new Set();
      const svg = figure.querySelector(".drawing svg"), title = svg ? svg.getAttribute("aria-label") : "";
      const box = element(figure, "div", { class: "curves-live" });
      figure.prepend(box);
      if (title) element(box, "h3", {}, title);
      this.labels(box);
      const x = content.panels.flatMap(p => p.x.flatMap(a => [a[0], a[a.length - 1]])).filter(v => v !== undefined);
      this.whole = [Math.min(...x), Math.max(...x)];
      this.window = [...this.whole];
      this.charts = content.panels.map((p, k) => this.panel(box, p, k === content.panels.length - 1));
    }

    // Buttons that hide and show curves, one for every name.
    labels(box) {
      const names = new Map();
      for (const c of this.content.panels.flatMap(p => p.curves)) if (c.label && !names.has(c.label)) names.set(c.label, c);
      const row = element(box, "div", { class: "choice", role: "group", "aria-label": "curves" });
      for (const [name, c] of names.size > 1 ? names : []) {
        const b = element(row, "button", { type: "button", "aria-pressed": true }, name);
        const key = document.createElement("i");
        key.style.color = c.color;
        if (c.style === "dashed") key.className = "dashed";
        b.prepend(key);
        b.onclick = () => {
          if (!this.hidden.delete(name)) this.hidden.add(name);
          b.setAttribute("aria-pressed", !this.hidden.has(name));
          for (const { u, of } of this.charts) of.forEach((curve, i) => { if (curve.label === name) u.setSeries(i + 1, { show: !this.hidden.has(name) }); });
        };
      }
      for (const [text, label, act] of [["◀", "earlier", () => this.pan(-.25)], ["▶", "later", () => this.pan(.25)],
        ["+", "closer", () => this.zoom(.5)], ["−", "wider", () => this.zoom(2)], ["all", "everything", () => this.show(...this.whole)]])
        element(row, "button", { type: "button", "aria-label": label, title: label }, text).onclick = act;
    }

    panel(box, panel, last) {
      const plot = element(box, "div", { class: "plot", tabindex: "0", role: "img", "aria-label": `${panel.title} ${panel.unit} over ${this.content.x}` });
      const head = element(plot, "h3", {}, panel.title), value = element(head, "small");
      const groups = panel.x.map((x, k) => panel.curves.filter(c => c.x === k));
      // Steps have equal abscissae, which a join of tables would merge.
      const apart = 1e-9 * (this.whole[1] - this.whole[0]);
      const ascending = panel.x.map(x => { let last = -Infinity; return x.map(v => last = v > last ? v : last + apart); });
      const tables = ascending.map((x, k) => [x, ...groups[k].map(c => c.y)]);
      const of = groups.flat(), data = tables.length > 1 ? uPlot.join(tables) : tables[0] || [[]];
      const log = this.content.logarithmic;
      const series = of.map(c => ({
        label: c.label, stroke: () => shade(c.color), width: c.style === "points" ? 0 : c.style === "thin" ? .7 : 1.5,
        dash: c.style === "dashed" ? [6, 4] : undefined,
        points: { show: c.style === "points", size: 5, fill: () => shade(c.color), stroke: () => shade(c.color) },
      }));
      const single = this.content.panels.length === 1;
      // A name that is longer than its axis stands below the chart.
      const fits = 7 * this.content.x.length < plot.clientWidth - 90;
      const made = chart(plot, {
        height: single ? 280 : 158, series: [{}, ...series],
        axes: [axis(last && fits ? this.content.x : undefined, 28), { ...axis(panel.unit, 62), space: 24 }],
        scales: { x: { time: false, ...(log ? { distr: 3 } : {}) }, y: log ? { distr: 3 } : { range: padded } },
        cursor: draggable(this, this.section.id),
        hooks: {
          setSelect: [dragged(this)],
          setCursor: [u => {
            const k = u.cursor.idx;
            value.textContent = k === null || k === undefined || !u.data[0].length ? ""
              : `${digits(u.data[0][k])}: ` + u.data.slice(1).map((y, s) => u.series[s + 1].show && y[k] !== null && y[k] !== undefined ? `${of[s].label} ${digits(y[k])}`.trim() : null).filter(x => x !== null).join(" · ");
          }],
        },
      }, data);
      keyboard(plot, this);
      if (last && !fits) element(plot, "p", { class: "small" }, `over: ${this.content.x}`);
      return { ...made, of };
    }

    show(from, to) {
      const least = 1e-4 * (this.whole[1] - this.whole[0]);
      if (!(to - from > least)) return;
      this.window = [Math.max(from, this.whole[0]), Math.min(to, this.whole[1])];
      for (const { u } of this.charts) u.setScale("x", { min: this.window[0], max: this.window[1] });
    }
    pan(share) {
      const d = this.window[1] - this.window[0];
      const a = Math.min(Math.max(this.window[0] + share * d, this.whole[0]), this.whole[1] - d);
      this.show(a, a + d);
    }
    zoom(factor) {
      const centre = this.content.logarithmic ? Math.sqrt(this.window[0] * this.window[1]) : (this.window[0] + this.window[1]) / 2;
      this.show(centre - factor * (centre - this.window[0]), centre + factor * (this.window[1] - centre));
    }
    resize() { for (const c of this.charts) c.u.setSize({ width: c.width(), height: c.u.height }); }
    recolor() { for (const c of this.charts) c.u.redraw(false); }
    seen() {}
  }

  // Range of a scale with some room, also around a constant.
  function padded(u, low, high) {
    if (low === null || high === null) return [-1, 1];
    const room = high > low ? .06 * (high - low) : .05 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  // Range with some room of all numbers of several series.
  function ends(all) {
    let low = null, high = null;
    for (const samples of all) for (const v of samples) {
      if (low === null || v < low) low = v;
      if (high === null || v > high) high = v;
    }
    return padded(null, low, high);
  }

  // Pearson's correlation of two series; NaN if one is constant.
  function correlation(x, y) {
    let n = 0, mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
    for (let k = 0; k < x.length; k++) {
      const dx = x[k] - mx, dy = y[k] - my;
      n++; mx += dx / n; my += dy / n;
      xx += dx * (x[k] - mx); xy += dx * (y[k] - my); yy += dy * (y[k] - my);
    }
    return xy / Math.sqrt(xx * yy);
  }

  // Range of a scale around zero that shows all but single outliers.
  function symmetric(u, low, high) {
    const m = Math.max(Math.abs(low || 0), Math.abs(high || 0)) || 1;
    return [-1.06 * m, 1.06 * m];
  }

  // Colours from light to dark of equal steps in lightness (viridis, Smith and van der Walt 2015, five of its colours).
  const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  function heat(x) {
    const k = Math.min(Math.max(x, 0), 1) * (RAMP.length - 1), i = Math.min(Math.floor(k), RAMP.length - 2), f = k - i;
    return `rgb(${RAMP[i].map((a, c) => Math.round(a + f * (RAMP[i + 1][c] - a))).join(",")})`;
  }

  const all = [];

  /// Draws the signals below `root`; resolves when they can be used.
  async function mount(root) {
    for (const section of root.querySelectorAll("[data-signals]")) {
      const panels = section.querySelector(".signals-panels");
      try {
        const header = JSON.parse(section.querySelector(".signals-header").textContent);
        const bytes = await inflate(section.querySelector(".signals-data").textContent);
        all.push(new Signals(section, header, bytes));
      } catch (error) {
        element(panels, "p", { class: "callout bad" }, `The curves cannot be drawn: ${error.message}`);
      }
    }
    for (const figure of root.querySelectorAll("figure:not(.live)")) {
      const content = figure.querySelector("script.curves");
      if (!content) continue;
      // Without the script's drawing the picture remains.
      try { all.push(new Curves(figure, JSON.parse(content.textContent))); figure.classList.add("live"); }
      catch (error) { figure.querySelector(".curves-live")?.remove(); console.error(error); }
    }
    document.documentElement.dataset.ready = performance.now().toFixed(0);
  }
  const living = () => all.filter(s => s.section.isConnected);
  let resized = 0;
  addEventListener("resize", () => { clearTimeout(resized); resized = setTimeout(() => living().forEach(s => s.resize()), 80); });
  addEventListener("scroll", () => living().forEach(s => s.seen()), { passive: true });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => living().forEach(s => s.recolor()));
  // Paper is light: the colours of the print's style come after this event.
  const paper = on => () => { document.documentElement.classList.toggle("paper", on); living().forEach(s => s.recolor()); };
  addEventListener("beforeprint", paper(true));
  addEventListener("afterprint", paper(false));
  return { mount, element, digits, keys, living, chart, axis, css };
})();
if (!document.documentElement.dataset.studio) deltatwin.mount(document);
