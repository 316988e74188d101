// The studio: shows the state of the session and asks for stages. Texts are set as text only; parts of pages come escaped
// from the server.
"use strict";
(() => {
  const { element, digits, keys, chart, axis, css } = deltatwin;
  const token = new URLSearchParams(location.search).get("token") || "";
  const $ = id => document.getElementById(id);
  const STEPS = [["data", "Data"], ["check", "Check"], ["fit", "Fit"], ["where", "Where"], ["why", "Why"], ["add", "Add"], ["next", "Next"], ["save", "Save"], ["watch", "Watch"]];
  const UNITS = ["", "s", "ms", "us", "rad", "deg", "rev", "rad/s", "deg/s", "rpm", "m", "mm", "Nm", "Nmm", "N", "A", "mA"];
  const CHANNELS = ["", "t", "q1", "q2", "q3", "q4", "tau1", "tau2", "tau3", "tau4", "qd1", "qd2", "qd3", "qd4"];
  let state = null, step = location.hash.slice(1) || "data", shown = "", columns = 0, follow = [];

  // ---- the server ----------------------------------------------------------------------------------------------------

  async function ask(path, options = {}) {
    const response = await fetch(path, { ...options, headers: { "x-token": token } });
    const answer = await response.json().catch(() => ({ error: response.statusText || "the server has not answered" }));
    if (answer?.error) throw new Error(answer.error);
    return answer;
  }
  async function act(request) {
    try { render(await ask("/api/do", { method: "POST", body: JSON.stringify(request) })); return true; } catch (error) { say(error.message); return false; }
  }
  // Models and effects that come with the program.
  const shipped = ask("/api/shipped");
  const part = async name => (await fetch(`/api/stage?name=${name}`, { headers: { "x-token": token } })).text();
  let own = "";
  function say(text) { own = text; $("message").textContent = text; $("message").hidden = !text; }

  // The server tells every change; a lost connection is made again by the browser. A window that nobody sees gives its
  // connection back: browsers open few of them to one server, and the others need theirs.
  let events = null;
  function listen() {
    events?.close();
    if (document.hidden) { events = null; return; }
    const own = events = new EventSource(`/api/events?token=${encodeURIComponent(token)}`);
    events.onmessage = event => { if (lost) { lost = false; say(""); } render(JSON.parse(event.data)); };
    events.onerror = () => {
      lost = true;
      say("The server does not answer. Start `deltatwin studio` on the same folder again; nothing is lost.");
      // After an answer that is no stream the browser gives up.
      if (own === events && own.readyState === EventSource.CLOSED) setTimeout(listen, 1500);
    };
  }
  document.addEventListener("visibilitychange", listen);
  let lost = false;

  // ---- frame ---------------------------------------------------------------------------------------------------------

  function render(next) {
    const before = state;
    state = next;
    $("folder").textContent = next.folder;
    $("job").hidden = !next.job;
    if (next.job) {
      const { stage, fraction, what, left, passed } = next.job;
      $("job-text").textContent = `${stage}${what ? ": " + what : ""}, ${passed.toFixed(0)} s` + (left !== null ? `, about ${Math.max(1, left).toFixed(0)} s left` : "");
      $("job-bar").value = fraction;
    }
    viewer.update(before);
    if (!before || before.revision !== next.revision) {
      if (next.message) say(next.message); else if (!lost) say("");
      blame(next.term);
      steps();
      bars();
      versions();
      panel();
      if (!next.job && follow.length && !next.message) { const request = follow.shift(); act(request); } else if (next.message) follow = [];
    }
    promised();
  }

  // Candidates as they are ranked before any is fitted, while Why tries them.
  function promised() {
    const box = $("first"), first = state.job?.stage === "why" ? state.job.first : [];
    if (!box || box.dataset.of === JSON.stringify(first)) return;
    box.dataset.of = JSON.stringify(first);
    box.replaceChildren();
    if (!first.length) return;
    element(box, "h3", {}, "First candidates");
    element(box, "p", { class: "small" }, "What each would explain as the only addition. None is fitted yet: the answer may be another one.");
    const cards = element(box, "div", { class: "candidates" });
    for (const { name, explained, p_adjusted } of first) {
      const card = element(cards, "article", { class: "candidate" }), percent = (100 * explained).toFixed(1);
      element(element(card, "header"), "h3", {}, name);
      const about = element(card, "p");
      shipped.then(({ effects }) => { about.textContent = effects.find(e => e.name === name)?.summary ?? ""; });
      const share = element(card, "div", { class: "share" });
      element(share, "span", {}, "alone");
      element(element(share, "div", { class: "bar" }), "i").style.width = `${percent}%`;
      element(share, "b", {}, `${percent} %`);
      const p = element(card, "p", { class: "small" });
      element(p, "b", {}, "p");
      p.append(` ${digits(+p_adjusted.toPrecision(2))}`);
    }
  }

  const result = name => state.session.stages[name];
  const current = () => state.session.current;
  const busy = () => !!state.job;

  function steps() {
    $("steps").replaceChildren();
    for (const [name, title] of STEPS) {
      const b = element($("steps"), "button", { type: "button" });
      if (name === step) b.setAttribute("aria-current", "step");
      const i = element(b, "i", { "aria-hidden": "true" }), r = result(name === "next" ? "why" : name);
      if (name === "data") i.className = state.session.recordings.length && current() !== null ? "good" : "";
      else if (name === "save") i.className = state.saved ? "good" : "";
      else if (name === "watch") i.className = { healthy: "good", changed: "bad" }[watched.verdict?.state] || "";
      else if (name === "next") i.className = r?.next ? "good" : "";
      else if (r) i.className = !r.good ? "bad" : r.version !== current() && name !== "check" ? "late" : "good";
      b.append(title);
      b.onclick = () => go(name);
    }
  }
  function go(name) {
    step = name;
    history.replaceState(null, "", `${location.pathname}${location.search}#${name}`);
    shown = "";
    steps();
    panel();
    $("panel").focus();
    // A new version of the model has no residuals yet.
    if (name === "where" && passed() && !busy() && result("where")?.version !== current()) act({ do: "where" });
  }

  function bars() {
    const box = $("bars"), chain = state.chain.map(k => state.session.versions[k]).filter(v => v.errors);
    const now = current() === null ? null : state.session.versions[current()].errors;
    if (!now) { box.replaceChildren(); element(box, "p", { class: "small" }, "Check the recordings to see the error of the model."); return; }
    if (box.children.length !== now.channels.length + 1 || !box.querySelector(".meter")) {
      box.replaceChildren();
      element(box, "div", { class: "small" });
      for (const name of now.channels) {
        const m = element(box, "div", { class: "meter" });
        const s = element(m, "span");
        element(s, "b", {}, name);
        element(s, "em");
        const bar = element(m, "div");
        element(bar, "i").style.width = "100%";
        element(bar, "u");
      }
    }
    const own = state.session.versions[current()];
    box.firstChild.textContent = `RMS${now.held_out ? " of held-out recordings" : ""}; dashed: noise`;
    keys(box.firstChild, [[own.what, `--${own.role}`]]);
    now.channels.forEach((name, c) => {
      const m = box.children[c + 1], top = Math.max(...chain.map(v => v.errors.rms[c]), now.noise_floor[c], 1e-300);
      m.querySelector("em").textContent = `${digits(now.rms[c])} ${now.units[c]}`;
      const i = m.querySelector("i"), ratio = now.rms[c] / now.noise_floor[c];
      requestAnimationFrame(() => { i.style.width = `${100 * now.rms[c] / top}%`; });
      i.style.background = `var(--${own.role})`;
      m.querySelector("u").style.left = `${100 * now.noise_floor[c] / top}%`;
      m.title = `${digits(ratio)} × noise`;
    });
  }

  function versions() {
    const list = $("versions");
    list.replaceChildren();
    state.session.versions.forEach((v, k) => {
      const li = element(list, "li", { class: k === current() ? "current" : state.chain.includes(k) ? "" : "off" });
      const b = element(li, "button", { type: "button", title: v.file }, v.what + (k === 0 ? ` (${v.file.replace("models/", "")})` : ""));
      b.onclick = () => act({ do: "version", version: k });
      if (v.parent !== null) {
        const d = element(li, "details");
        element(d, "summary", { class: "small" }, "what changed");
        d.ontoggle = async () => {
          if (!d.open || d.dataset.done) return;
          d.dataset.done = 1;
          try {
            const diff = await ask(`/api/difference?version=${k}`);
            for (const text of diff.effects) element(d, "p", { class: "small" }, text);
            const body = element(element(d, "table"), "tbody");
            // What the shown digits do not tell apart has not changed.
            const seen = diff.parameters.filter(p => digits(p.before) !== digits(p.after));
            if (!seen.length) element(d, "p", { class: "small" }, "No number changed.");
            for (const p of seen) {
              const tr = element(body, "tr");
              element(tr, "td", {}, p.name);
              element(tr, "td", {}, `${p.before === null ? "new:" : `${digits(p.before)} →`} ${digits(p.after)}${p.unit === "1" ? "" : ` ${p.unit}`}`);
            }
          } catch (error) { say(error.message); }
        };
      }
    });
    $("undo").disabled = busy() || current() === null || state.session.versions[current()].parent === null;
  }

  // ---- Rerun beside --------------------------------------------------------------------------------------------------

  // Handle above the viewer that shares the window's height between it and the page: dragged, or moved by arrow keys.
  const LEAST = 15, MOST = 85;
  let height = 48;
  function splitter(box) {
    const handle = element(box, "div", { class: "splitter", role: "separator", tabindex: "0", "aria-orientation": "horizontal", "aria-label": "height of the viewer", "aria-valuemin": LEAST, "aria-valuemax": MOST });
    const set = share => {
      height = Math.min(Math.max(share, LEAST), MOST);
      box.style.setProperty("--viewer", `${height}vh`);
      handle.setAttribute("aria-valuenow", Math.round(height));
    };
    let from = null;
    const dragged = on => document.body.classList.toggle("dragged", on);
    handle.onpointerdown = e => { from = [e.clientY, height]; handle.setPointerCapture(e.pointerId); dragged(true); e.preventDefault(); handle.focus(); };
    handle.onpointermove = e => { if (from) set(from[1] + 100 * (from[0] - e.clientY) / innerHeight); };
    handle.onpointerup = handle.onpointercancel = () => { from = null; dragged(false); };
    handle.onkeydown = e => {
      const to = { ArrowUp: height + 5, ArrowDown: height - 5, Home: LEAST, End: MOST }[e.key];
      if (to !== undefined) { set(to); e.preventDefault(); }
    };
    set(height);
  }

  // The viewer in a frame of its own; the cursors of charts and viewer follow each other.
  const viewer = {
    serial: 0, wanted: false,
    open() {
      this.wanted = true;
      // What was shown before is made anew.
      this.serial = state.shown ? state.shown.serial : 0;
      act({ do: "view" });
    },
    close() {
      this.wanted = false;
      this.serial = 0;
      $("viewer").replaceChildren();
      $("viewer").hidden = true;
      $("look").setAttribute("aria-expanded", false);
    },
    // Shows the file that the server has written since; a new model is shown, too.
    update(before) {
      $("look").hidden = !state.viewer || !state.session.recordings.length || current() === null;
      if (!this.wanted) return;
      const { shown } = state;
      const changed = before && before.session.current !== state.session.current && state.session.current !== null;
      if (changed && shown && shown.version !== current() && !busy() && !follow.length) act({ do: "view" });
      if (!shown || shown.serial === this.serial) return;
      this.serial = shown.serial;
      const box = $("viewer");
      box.replaceChildren();
      box.hidden = false;
      $("look").setAttribute("aria-expanded", true);
      splitter(box);
      const details = element(box, "details");
      element(details, "summary", {}, `${shown.recording} with ${state.session.versions[shown.version].what}; in a window of its own:`);
      for (const text of shown.commands) command(details, text);
      const renderer = new URLSearchParams(location.search).get("renderer");
      const theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
      const more = renderer ? `&renderer=${encodeURIComponent(renderer)}` : "";
      this.frame = element(box, "iframe", { title: "Rerun viewer", src: `/viewer?token=${token}&theme=${theme}&serial=${shown.serial}${more}` });
    },
  };
  $("look").onclick = () => viewer.wanted ? viewer.close() : viewer.open();
  addEventListener("message", event => {
    if (event.origin !== location.origin || event.source !== viewer.frame?.contentWindow) return;
    if (event.data.failed) say(event.data.failed);
    if (isFinite(event.data.time)) for (const chart of deltatwin.living()) chart.mark?.(event.data.time);
  });
  addEventListener("deltatwin-time", event => viewer.frame?.contentWindow?.postMessage({ time: event.detail }, location.origin));

  // ---- panels --------------------------------------------------------------------------------------------------------

  // Only what has changed is drawn again, so that an open window or a half-typed number stays.
  function panel() {
    const s = state.session;
    const key = JSON.stringify([step, busy(), s.generation, current(), result(step), step === "data" ? [s.recordings, s.how, s.versions.length] : 0, step === "add" ? result("why") : 0, step === "next" ? result("why") : 0, step === "save" ? [state.saved, state.revision] : 0]);
    if (key === shown) return;
    shown = key;
    const box = $("panel");
    box.replaceChildren();
    element(box, "h2", {}, STEPS.find(([name]) => name === step)[1]);
    panels[step](box);
  }

  function button(box, text, request, enabled = true, then = []) {
    const b = element(box, "button", { type: "button", class: "go" }, text);
    b.disabled = busy() || !enabled;
    b.onclick = async () => { follow = [...then]; if (!await act(request)) follow = []; };
    return b;
  }
  function command(box, text) {
    if (!text) return;
    const line = element(box, "div", { class: "command" });
    element(line, "code", {}, text);
    const b = element(line, "button", { type: "button", "aria-label": "copy the command" }, "copy");
    b.onclick = async () => { try { await navigator.clipboard.writeText(text); b.textContent = "copied"; } catch { getSelection().selectAllChildren(line.firstChild); b.textContent = "select"; } };
  }
  function outcome(box, name, then) {
    const r = result(name);
    if (!r) return;
    const late = r.version !== current() && name !== "check";
    const stale = "This is of another version of the model; do it again for the one in use.";
    // The diagnosis says its verdict itself.
    if (late || name !== "why") element(box, "div", { class: `callout ${r.good ? late ? "warning" : "note" : "bad"}` }, late ? stale : r.message);
    command(box, r.command);
    const content = element(box, "div", { "data-part": name });
    part(name).then(html => {
      content.innerHTML = html;
      deltatwin.mount(content);
      then?.(content, r);
    }, error => say(error.message));
  }
  const passed = () => result("check")?.good;
  function need(box) {
    if (!passed()) element(box, "p", { class: "small" }, "First the check must pass.");
    return passed();
  }

  const panels = {
    data(box) {
      const s = state.session;
      const drop = element(box, "div", { class: "drop" });
      element(drop, "div", {}, "Drop recordings (CSV, text tables, MCAP, SQLite or folders of ROS 2 bags), a model (.toml) and setups (.setup.toml) here");
      const input = element(drop, "input", { type: "file", multiple: "", "aria-label": "files" });
      input.onchange = () => upload([...input.files].map(file => ({ path: file.name, file })));
      const folder = element(element(drop, "label", { class: "small" }, "or a folder "), "input", { type: "file", webkitdirectory: "", "aria-label": "folder" });
      folder.onchange = () => upload([...folder.files].map(file => ({ path: file.webkitRelativePath, file })));
      const uploads = element(box, "p", { id: "uploads", role: "status", hidden: "" });
      element(uploads, "span"); element(uploads, "progress", { max: "1", value: "0", "aria-label": "share sent" });
      if (!s.recordings.length) {
        element(box, "h3", {}, "No files at hand?");
        const row = element(box, "div", { class: "row" });
        button(row, "Try an example", { do: "example" });
        element(row, "span", { class: "grow small" }, "simulates two motions of a robot whose model lacks one effect; hidden.txt in the folder names it");
        command(box, "deltatwin example -o example");
      }
      element(box, "h3", {}, "Recordings");
      if (!s.recordings.length) element(box, "p", { class: "small" }, "none yet");
      s.recordings.forEach((r, k) => {
        const row = element(box, "div", { class: "row" });
        element(row, "b", {}, r.file.replace("data/", ""));
        element(row, "span", { class: "grow small" }, (r.held_out ? "held out: the fit does not see it, it judges the model" : "fit: the parameters are fitted to it") + (r.payload_mass !== null ? `; payload ${digits(r.payload_mass)} kg` : ""));
        const use = element(row, "button", { type: "button" }, r.held_out ? "use to fit" : "hold out");
        use.onclick = () => act({ do: "hold_out", recording: k });
        const look = element(row, "button", { type: "button", "aria-pressed": k === columns }, "show columns");
        look.onclick = () => { columns = k; shown = ""; panel(); };
        const out = element(row, "button", { type: "button", "aria-label": `leave out ${r.file}` }, "✕");
        out.onclick = () => act({ do: "leave_out", recording: k });
        const drops = r.maps.map((map, i) => {
          const own = element(box, "div", { class: "row" });
          element(own, "span", { class: "small" }, "read with");
          element(own, "code", { class: "grow" }, map);
          const drop = element(own, "button", { type: "button", "aria-label": `read ${r.file} without ${map}` }, "✕");
          drop.onclick = () => act({ do: "without", recording: k, map: i });
          return drop;
        });
        for (const b of [use, out, ...drops]) b.disabled = busy();
      });
      element(box, "h3", {}, "Model");
      const row = element(box, "div", { class: "row" });
      element(row, "b", {}, s.versions.length ? s.versions[0].file.replace("models/", "") : "none yet");
      element(row, "span", { class: "grow" });
      const select = element(row, "select", { "aria-label": "model that comes with the program" });
      element(select, "option", { value: "" }, "choose one of the program’s …");
      shipped.then(({ models }) => { for (const name of models) element(select, "option", { value: name }, name); });
      select.disabled = busy();
      select.onchange = () => select.value && act({ do: "shipped", model: select.value });
      if (s.recordings.length) {
        columns = Math.min(columns, s.recordings.length - 1);
        const place = element(box, "div");
        ask(`/api/columns?recording=${columns}`).then(c => columnTable(place, c), error => element(place, "p", { class: "callout bad" }, error.message));
        if (current() !== null) {
          const next = element(box, "p");
          button(next, "Check", { do: "check" }).addEventListener("click", () => go("check"));
        }
      }
    },

    check(box) {
      const r = result("check");
      button(box, r ? "Check again" : "Check", { do: "check" }, state.session.recordings.length && current() !== null);
      if (!state.session.recordings.length || current() === null) element(box, "p", { class: "small" }, "Drop a recording and choose a model first.");
      if (!r) return;
      const p = element(box, "p");
      element(p, "span", { class: `light ${!r.good ? "bad" : r.remedies.length ? "warn" : "good"}`, "aria-hidden": "true" });
      p.append(r.message);
      const map = new Set();
      for (const remedy of r.remedies) {
        const card = element(box, "div", { class: `remedy${remedy.severe ? " severe" : ""}` });
        element(card, "p", {}, remedy.sentence);
        if (remedy.kind === "words") { element(card, "p", { class: "small" }, `Remedy: ${remedy.text}`); continue; }
        const option = remedy.kind === "map" ? `--map "${remedy.text}"` : `payload of ${remedy.text} kg`;
        element(card, "p").append(Object.assign(document.createElement("code"), { textContent: option }));
        // One click cures everything that one mapping names.
        const one = `${option} of ${remedy.recording}`;
        if (map.has(one)) { element(card, "p", { class: "small" }, "is part of the remedy above"); continue; }
        map.add(one);
        const b = element(card, "button", { type: "button" }, "apply and check again");
        b.disabled = busy();
        b.onclick = () => {
          follow = [{ do: "check" }];
          if (remedy.kind === "map") act({ do: "remedy", recording: remedy.recording, map: remedy.text });
          else act({ do: "weigh", recording: remedy.recording, mass: +remedy.text });
        };
      }
      if (!r.good) {
        const b = element(element(box, "p"), "button", { type: "button", class: "file" }, "go on all the same (--no-gate)");
        b.onclick = () => { follow = [{ do: "check" }]; act({ do: "read", how: { ...state.session.how, no_gate: true } }); };
      }
      command(box, r.command);
      const content = element(box, "div");
      part("check").then(html => { content.innerHTML = html; });
      if (r.good) { const p = element(box, "p"); button(p, "Fit", { do: "fit" }).addEventListener("click", () => go("fit")); }
    },

    fit(box) { const ok = need(box); button(box, "Fit the model", { do: "fit" }, ok); outcome(box, "fit"); if (result("fit")) element(element(box, "p"), "button", { type: "button", class: "go" }, "Where does it fail?").onclick = () => go("where"); },
    where(box) { const ok = need(box); button(box, "Where does the model fail?", { do: "where" }, ok); outcome(box, "where"); if (result("where")) button(element(box, "p"), "Why?", { do: "why" }, ok).addEventListener("click", () => go("why")); },
    why(box) {
      const ok = need(box);
      button(box, "Which effect is missing?", { do: "why" }, ok);
      element(box, "div", { id: "first" });
      promised();
      outcome(box, "why", (content, r) => {
        for (const card of content.querySelectorAll(".candidate[data-effect]")) {
          const name = card.dataset.effect, found = card.classList.contains("found") || card.classList.contains("open");
          const b = element(card, "button", { type: "button" }, `Add ${name}`);
          if (!found) b.style.cssText = "background:none;color:inherit;font-weight:400;border-color:var(--line)";
          b.disabled = busy() || r.version !== current();
          b.onclick = () => { act({ do: "add", effect: name }); go("add"); };
        }
      });
    },
    add(box) {
      const ok = need(box), r = result("why");
      const row = element(box, "div", { class: "fields" });
      const select = element(element(row, "label", {}, "effect "), "select");
      const named = r && r.version === current() ? r.named : [];
      const b = element(row, "button", { type: "button", class: "go" }, "Add the effect");
      b.onclick = () => act({ do: "add", effect: select.value, laws: select.value === "formula" ? laws() : [] });
      const about = element(box, "p", { class: "small", role: "status" });
      const laws = formula(element(box, "div"), good => { b.disabled = busy() || !ok || !select.value || (select.value === "formula" && !good); });
      shipped.then(({ effects }) => {
        const known = new Map(effects.map(e => [e.name, e]));
        for (const name of [...named, ...effects.map(e => e.name).filter(n => !named.includes(n))]) {
          element(select, "option", { value: name }, name + (named.includes(name) ? " (named by Why)" : ""));
        }
        const choose = () => {
          chosen = select.value;
          const e = known.get(chosen);
          about.textContent = !e ? "" : chosen === "formula" ? `${e.summary}.` : `${e.summary}: ${e.law}. Shows as ${e.shows}.`;
          laws.show(chosen === "formula");
        };
        if (!named.length && known.has(chosen)) select.value = chosen;
        select.onchange = choose;
        choose();
        blame(state.term);
      });
      outcome(box, "add");
    },
    next(box) {
      const r = result("why");
      if (!r) { element(box, "p", { class: "small" }, "The diagnosis (Why) proposes what to measure next."); return; }
      element(box, "p", {}, r.next ? `Next experiment: ${r.next}` : "The diagnosis proposes no experiment: it leaves no question that a motion of this machine would decide.");
      if (r.next && !r.files.length) element(box, "p", { class: "small" }, "It has no scenario of its own: it repeats the motion of the recordings, or needs the machine taken apart.");
      for (const file of r.files) {
        element(box, "p", {}, "Its motion as a scenario, to be simulated or run on the machine:");
        element(element(box, "p"), "a", { href: `/api/file?name=${encodeURIComponent(file)}&token=${token}`, download: file, class: "file" }, `download ${file}`);
        command(box, `deltatwin simulate ${file} -o next.mcap`);
      }
    },
    save(box) {
      element(box, "p", {}, "One page with everything found so far, that needs no server; and the folder itself is the session.");
      const late = passed() && result("where") && result("where").version !== current();
      button(box, "Save the page", { do: late ? "where" : "save" }, Object.keys(state.session.stages).length > 0, late ? [{ do: "save" }] : []);
      if (state.saved) element(element(box, "p"), "a", { href: `/api/file?name=report.html&token=${token}`, target: "_blank", class: "file" }, "saved: open report.html");
      element(box, "h3", {}, "The same on the command line");
      const chain = state.chain.map(k => state.session.versions[k].command).filter(c => c);
      for (const c of [`cd ${state.folder}`, result("check")?.command, ...chain, result("why")?.command]) command(box, c);
    },
  };

  // ---- a machine that runs -------------------------------------------------------------------------------------------

  // What was heard of the watch so far: a column per chart's curve.
  const watched = { next: 0, command: "", verdict: null, remarks: [], status: null, channels: [], healthy: null, learned: null, t: [], over: [], level: [], margins: { t: [], least: [] }, where: "" };
  // Seconds that the charts show at most, and pause between two looks, ms.
  const SHOWN = 3600, LOOK = 500;
  const fields = { follow: "", mqtt: "", topic: "", learn: "60", idle: "10", healthy: "" };

  function hear(answer) {
    // A new watch counts from zero.
    if (answer.command !== watched.command) Object.assign(watched, { command: answer.command, channels: [], healthy: null, learned: null, t: [], over: [], level: [], margins: { t: [], least: [] }, where: "" });
    for (const { topic, answer: a } of answer.answers) {
      if (topic === "residual") {
        watched.channels = a.channels;
        watched.healthy = a.healthy_rms;
        watched.learned = a.learned || null;
        watched.t.push(a.t[1]);
        watched.over.push(a.healthy_rms ? a.rms.map((r, c) => r / a.healthy_rms[c]) : a.channels.map(() => null));
        watched.level.push(a.level ?? null);
      } else if (topic === "margins" && a.weakest) {
        watched.margins.t.push(a.t);
        watched.margins.least.push(a.weakest.margin);
        watched.where = a.weakest.socket;
      }
    }
    for (const list of [watched.t, watched.over, watched.level, watched.margins.t, watched.margins.least]) if (list.length > SHOWN) list.splice(0, list.length - SHOWN);
    for (const key of ["next", "verdict", "remarks", "status"]) watched[key] = answer[key];
  }

  // Asks for what is new and draws it while the watch goes on and its panel is shown.
  async function listenTo(view) {
    for (;;) {
      let answer;
      try { answer = await ask(`/api/watch?from=${watched.next}`); } catch (error) { say(error.message); return; }
      if (!view.box.isConnected) return;
      if (answer?.command) {
        if (answer.command !== watched.command && watched.next) { watched.next = 0; watched.command = ""; continue; }
        hear(answer);
        view.draw();
        steps();
        if (answer.status !== null && !answer.answers.length) return;
        if (answer.answers.length > 100) continue;
      } else return;
      await new Promise(done => setTimeout(done, LOOK));
    }
  }

  function sentence() {
    const v = watched.verdict, ended = watched.status !== null;
    if (!v) return ended ? ["bad", `The watch could not begin: ${watched.remarks.join(" ") || "no reason is known"}`] : ["note", "Waiting for the first second of samples."];
    const end = ended ? "The stream has ended. " : "", highest = `highest level ${digits(v.highest_level)} of the alarm’s`;
    if (v.state === "learning") return [ended ? "warning" : "note", end + (watched.learned ? `Learning the healthy residual: ${watched.learned[0].toFixed(0)} of ${watched.learned[1].toFixed(0)} s.` : "Learning the healthy residual.")];
    if (v.state === "healthy") return ["good", `${end}The machine is as it was: ${highest}; a healthy machine raises at most ${digits(v.false_alarms_per_hour)} false alarms per hour.`];
    return ["bad", `${end}The machine has changed since about ${digits(v.alarm.onset)} s: ${v.alarm.statistic}; ${highest}.`];
  }

  // What has changed, in words.
  function causes(box) {
    const cause = watched.verdict?.cause;
    if (!cause) return;
    const list = element(box, "ul");
    for (const effect of cause.effects || []) {
      const item = element(list, "li");
      element(item, "code", {}, effect.name);
      const parameters = Object.entries(effect.parameters).map(([name, p]) => p.before ? `${name} ${digits(p.before)} → ${digits(p.after)} ${p.unit}` : `${name} ${digits(p.after)} ${p.unit}`);
      item.append(` ${effect.kind === "new" ? "is new" : "has changed"}: ${parameters.join(", ")}`);
      if (effect.indistinguishable.length) item.append(`; or ${effect.indistinguishable.join(", ")}, which these data do not distinguish`);
    }
    if (cause.problem) element(list, "li", {}, `no cause yet: ${cause.problem}`);
    else if (!cause.effects?.length) element(list, "li", {}, "no effect of the library has changed");
    else element(list, "li", {}, `together ${(100 * cause.explained).toFixed(0)} % of the error above the noise, on held-out data`);
  }

  class WatchView {
    constructor(box) {
      this.box = element(box, "div", { class: "watch" });
      this.verdict = element(this.box, "div", { role: "status" });
      this.cause = element(this.box, "div");
      this.plots = element(this.box, "div");
      this.line = element(this.box, "div");
      this.remarks = element(this.box, "details", { hidden: "" });
      this.charts = [];
    }
    // Charts of the channels that there are.
    build() {
      this.built = watched.channels.join();
      this.plots.replaceChildren();
      const line = (stroke, dash) => ({ stroke: () => css(stroke), width: 1.5, dash, points: { show: false } }), limit = color => line(color, [6, 4]);
      const colors = watched.channels.map((_, c) => `--axis-${c % 4 + 1}`);
      const one = (title, unit, entries, series, data) => {
        const plot = element(this.plots, "div", { class: "plot", role: "img", "aria-label": `${title} over time` });
        element(plot, "h3", {}, title);
        keys(plot, entries);
        return { ...chart(plot, { height: 170, cursor: { show: false }, scales: { x: { time: false }, y: { range: (u, low, high) => [Math.min(0, low ?? 0), Math.max(1.2, 1.08 * (high ?? 1))] } }, axes: [axis("t / s", 28), axis(unit, 62)], series: [{}, ...series] }, data()), data };
      };
      const t = () => watched.t, ones = () => watched.t.map(() => 1);
      this.charts = [
        one("Residual over its healthy value", "× healthy", [...watched.channels.map((name, c) => [name, colors[c]]), ["healthy", "--noise"]], [...colors.map(color => line(color)), limit("--noise")],
          () => [t(), ...watched.channels.map((_, c) => watched.over.map(row => row[c] ?? null)), ones()]),
        one("Level of the alarm: above 1 the machine has changed", "level", [["level", "--measured"], ["alarm", "--bad"]], [line("--measured"), limit("--bad")], () => [t(), watched.level, ones()]),
      ];
      if (watched.margins.t.length) this.charts.push(one("Least margin of the ball sockets", "N", [["margin", "--measured"], ["the socket leaves its ball", "--bad"]], [line("--measured"), limit("--bad")],
        () => [watched.margins.t, watched.margins.least, watched.margins.t.map(() => 0)]));
    }
    draw() {
      const [kind, text] = sentence();
      if (this.verdict.textContent !== text) { this.verdict.className = `callout ${kind}`; this.verdict.textContent = text; }
      const cause = JSON.stringify(watched.verdict?.cause);
      if (this.known !== cause) { this.known = cause; this.cause.replaceChildren(); causes(this.cause); }
      if (!this.line.children.length || this.of !== watched.command) { this.of = watched.command; this.line.replaceChildren(); command(this.line, watched.command); }
      this.remarks.hidden = !watched.remarks.length;
      if (this.said !== watched.remarks.length) {
        this.said = watched.remarks.length;
        this.remarks.replaceChildren();
        element(this.remarks, "summary", { class: "small" }, "remarks of the watch");
        for (const remark of watched.remarks) element(this.remarks, "p", { class: "small" }, remark);
      }
      if (!watched.t.length) return;
      if (this.built !== watched.channels.join() || (watched.margins.t.length > 0) !== (this.charts.length > 2)) this.build();
      else for (const c of this.charts) c.u.setData(c.data());
      this.end?.(watched.status !== null);
    }
    resize() { for (const c of this.charts) c.u.setSize({ width: c.width(), height: c.u.height }); }
    recolor() { for (const c of this.charts) c.u.redraw(false); }
  }
  let watching = null;
  addEventListener("resize", () => watching?.box.isConnected && watching.resize());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => watching?.box.isConnected && watching.recolor());

  panels.watch = box => {
    element(box, "p", {}, "Compares a machine that runs with the model in use, second by second: residual against its healthy value, an alarm when it is no longer that of the healthy machine, what has changed since, and the margins of the ball sockets.");
    const form = element(box, "div", { class: "fields" });
    const field = (label, key, attributes) => {
      const input = element(element(form, "label", {}, `${label} `), "input", { type: "text", spellcheck: "false", autocomplete: "off", ...attributes });
      input.value = fields[key];
      input.oninput = () => { fields[key] = input.value; ready(); };
      return input;
    };
    field("file that grows (CSV, MCAP)", "follow", { placeholder: "/data/growing.csv" });
    field("or broker", "mqtt", { placeholder: "mqtt://127.0.0.1:1883" });
    field("its topic", "topic", { placeholder: "robot/joints" });
    const healthy = element(element(form, "label", {}, "healthy: "), "select");
    element(healthy, "option", { value: "" }, "the first seconds");
    for (const r of state.session.recordings) element(healthy, "option", { value: r.file }, r.file.replace("data/", ""));
    healthy.value = fields.healthy;
    if (healthy.selectedIndex < 0) healthy.value = fields.healthy = "";
    const learn = field("healthy seconds", "learn", { type: "number", min: "1", step: "any" });
    healthy.onchange = () => { fields.healthy = healthy.value; ready(); };
    field("ends after seconds without samples", "idle", { type: "number", min: "1", step: "any" });
    const row = element(box, "p"), go = element(row, "button", { type: "button", class: "go" }, "Watch"), stop = element(row, "button", { type: "button", class: "file" }, "End the watch");
    const runs = () => watched.command && watched.status === null;
    const ready = () => {
      learn.disabled = fields.healthy !== "";
      go.disabled = runs() || current() === null || !(fields.follow.trim() || (fields.mqtt.trim() && fields.topic.trim()));
      stop.disabled = !runs();
    };
    if (current() === null) element(box, "p", { class: "small" }, "Choose a model first (Data).");
    const view = watching = new WatchView(box);
    view.end = ready;
    go.onclick = async () => {
      if (!await act({ do: "watch", ...fields, learn: +fields.learn || null, idle: +fields.idle || null })) return;
      Object.assign(watched, { next: 0, command: "" });
      if (view.box.isConnected) listenTo(view);
    };
    stop.onclick = () => act({ do: "unwatch" });
    ready();
    listenTo(view);
  };

  // ---- a law that is typed -------------------------------------------------------------------------------------------

  // What was typed and chosen last, which stays when the panel is drawn again.
  let typed = [], chosen = "";
  // Shows at the typed term `k` that its law has no value at some sample.
  function blame(k) {
    const row = document.querySelectorAll(".term")[k ?? -1];
    if (!row) return;
    row.querySelector("input").setAttribute("aria-invalid", true);
    row.querySelector(".verdict").textContent = state.message;
  }

  // Fields for the terms of a formula, checked by the server while they are typed; calls `judged` with whether all are good.
  function formula(box, judged) {
    const rows = element(box, "div"), goods = [];
    const told = () => judged(goods.length > 0 && goods.every(g => g.good));
    const add = before => {
      const row = element(rows, "div", { class: "term" }), k = goods.length + 1;
      const at = element(row, "select", { "aria-label": `place of term ${k}` });
      const law = element(row, "input", { type: "text", spellcheck: "false", autocomplete: "off", placeholder: "-tanh(50*qd1)", "aria-label": `law of term ${k}` });
      const verdict = element(row, "div", { class: "verdict small", role: "status" });
      const own = { at, law, good: false };
      goods.push(own);
      law.value = before?.law ?? "";
      let asked = 0;
      const check = async () => {
        const turn = ++asked;
        let answer;
        try { answer = await ask(`/api/formula?at=${encodeURIComponent(at.value)}&law=${encodeURIComponent(law.value)}`); } catch (error) { answer = { problem: error.message, from: 0, to: 0, known: { places: [], variables: [] } }; }
        if (turn !== asked) return;
        if (!at.options.length) {
          for (const place of answer.known.places) element(at, "option", { value: place }, place);
          if (answer.known.places.includes(before?.at)) at.value = before.at;
          if (law.value || at.value) return check();
        }
        typed = goods.map(g => ({ at: g.at.value, law: g.law.value }));
        own.good = answer.unit !== undefined;
        verdict.replaceChildren();
        law.setAttribute("aria-invalid", law.value !== "" && !own.good);
        if (own.good) element(verdict, "span", {}, `coefficient in ${answer.unit}`);
        else if (law.value) {
          // The text with the place of the fault marked.
          const text = element(verdict, "code");
          text.append(law.value.slice(0, answer.from));
          element(text, "mark", {}, law.value.slice(answer.from, Math.max(answer.to, answer.from + 1)) || "␣");
          text.append(law.value.slice(Math.max(answer.to, answer.from + 1)));
          verdict.append(` ${answer.problem}`);
        } else verdict.textContent = `of ${answer.known.variables.join(" ")} t, with sin cos tan tanh exp abs sign sqrt min max pi`;
        told();
        if (state.term === k - 1 && law.value === before?.law) blame(state.term);
      };
      law.oninput = check;
      at.onchange = check;
      check();
    };
    const more = element(element(box, "p"), "button", { type: "button", class: "file" }, "another term");
    more.onclick = () => add();
    const laws = () => goods.filter(g => g.law.value).map(g => `${g.at.value}: ${g.law.value}`);
    laws.show = on => { box.hidden = !on; if (on && !goods.length) (typed.length ? typed : [undefined]).forEach(add); if (on) told(); else judged(true); };
    return laws;
  }

  // ---- columns of a recording ----------------------------------------------------------------------------------------

  function columnTable(box, c) {
    element(box, "h3", {}, `${c.file.replace("data/", "")}: ${c.rows} ${c.table ? "rows" : "samples"}`);
    if (c.problem) element(box, "div", { class: "callout bad" }, c.problem);
    const cure = element(box, "p");
    if (c.warnings.length) { const d = element(box, "details"); element(d, "summary", { class: "small" }, c.warnings.length === 1 ? "1 remark of the reader" : `${c.warnings.length} remarks of the reader`); const ul = element(d, "ul", { class: "small" }); for (const w of c.warnings) element(ul, "li", {}, w); }
    const wide = element(box, "div", { class: "wide", tabindex: "0", role: "group", "aria-label": "columns" }), table = element(wide, "table", { class: "map" });
    const head = element(element(table, "thead"), "tr");
    for (const text of c.table ? ["column", "signal", "first", "is", "unit", "opposite sign"] : ["channel", "signal"]) element(head, "th", {}, text);
    const body = element(table, "tbody"), rows = [];
    for (const column of c.columns) {
      const tr = element(body, "tr");
      element(tr, "td").append(Object.assign(document.createElement("code"), { textContent: column.name }));
      spark(element(element(tr, "td"), "canvas", { role: "img", "aria-label": `signal ${column.name}` }), column.stretches);
      if (!c.table) continue;
      element(tr, "td", { class: "small" }, column.first.map(x => x !== "" && isFinite(x) ? digits(+x) : x).join(", "));
      const is = element(element(tr, "td"), "select", { "aria-label": `channel of ${column.name}` });
      for (const name of CHANNELS.includes(column.channel) || !column.channel ? CHANNELS : [...CHANNELS, column.channel]) element(is, "option", { value: name }, name || "–");
      is.value = column.channel || "";
      const unit = element(element(tr, "td"), "select", { "aria-label": `unit of ${column.name}` });
      for (const name of UNITS) element(unit, "option", { value: name }, name || "as named");
      const turned = element(element(tr, "td"), "input", { type: "checkbox", "aria-label": `opposite sign of ${column.name}` });
      rows.push({ column, is, unit, turned });
    }
    let apply = null;
    if (c.problem?.includes("looks like degrees")) {
      const angles = rows.filter(r => /^q[1-4]$/.test(r.is.value));
      const b = element(cure, "button", { type: "button", class: "file" }, "the angles are in degrees: read them so");
      b.disabled = busy() || !angles.length;
      b.onclick = () => { for (const r of angles) r.unit.value = "deg"; apply.click(); };
    }
    const how = state.session.how, fields = element(box, "div", { class: "fields" });
    const field = (label, key) => { const i = element(element(fields, "label", {}, label + " "), "input", { type: "number", step: "any", min: "0" }); i.value = how[key] ?? ""; return [key, i]; };
    const numbers = [field("payload / kg", "payload_mass"), field("samples per second, without times", "rate"), field("gear ratio of the motor’s side", "gear_ratio")];
    if (how.maps.length) {
      element(box, "p", { class: "small" }, "Read with:");
      how.maps.forEach((map, k) => {
        const row = element(box, "div", { class: "row" });
        element(row, "code", { class: "grow" }, `--map "${map}"`);
        const b = element(row, "button", { type: "button", "aria-label": "without this mapping" }, "✕");
        b.onclick = () => act({ do: "read", how: { ...how, maps: how.maps.filter((_, i) => i !== k) } });
      });
    }
    apply = element(element(box, "p"), "button", { type: "button", class: "go" }, "Read the recordings this way");
    apply.disabled = busy();
    apply.onclick = () => {
      const quote = name => name.includes("'") ? `"${name}"` : `'${name}'`;
      const changed = rows.filter(r => r.is.value && (r.is.value !== (r.column.channel || "") || r.unit.value || r.turned.checked));
      const map = changed.map(r => `${r.is.value}=${quote(r.column.name)}${r.unit.value ? `[${r.unit.value}]` : ""}${r.turned.checked ? "*-1" : ""}`).join(", ");
      const next = structuredClone(how);
      // A new assignment of columns takes the place of the last one; what was applied after it may no longer fit.
      if (map) next.maps = [map];
      for (const [key, input] of numbers) next[key] = input.value === "" ? null : +input.value;
      act({ do: "read", how: next });
    };
  }
  function spark(canvas, stretches) {
    const ratio = devicePixelRatio || 1, w = 150, h = 34;
    canvas.width = w * ratio; canvas.height = h * ratio;
    const ctx = canvas.getContext("2d"), known = stretches.filter(s => s);
    ctx.scale(ratio, ratio);
    const low = Math.min(...known.map(s => s[0])), high = Math.max(...known.map(s => s[1])), span = high - low || 1;
    ctx.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--measured");
    ctx.beginPath();
    stretches.forEach((s, k) => {
      if (!s) return;
      const x = (k + .5) * w / stretches.length, y = v => h - 2 - (h - 4) * (v - low) / span;
      k ? ctx.lineTo(x, y(s[0])) : ctx.moveTo(x, y(s[0]));
      ctx.lineTo(x, y(s[1]));
    });
    ctx.stroke();
    if (known.length) canvas.title = `${digits(low)} to ${digits(high)}`;
  }

  // ---- files ---------------------------------------------------------------------------------------------------------

  const METADATA = "metadata.yaml";

  // Sends files with their paths; those of a folder with the metadata of a bag are one recording.
  async function upload(all) {
    const failed = [], folder = path => path.slice(0, Math.max(0, path.lastIndexOf("/"))), last = path => path.slice(path.lastIndexOf("/") + 1);
    const bags = new Map();
    for (const { path } of all) if (last(path) === METADATA && folder(path)) bags.set(folder(path), []);
    const single = [];
    for (const one of all) (bags.get(folder(one.path)) || single).push(one);
    // Setups belong to recordings that come after them.
    single.sort((a, b) => b.path.endsWith(".toml") - a.path.endsWith(".toml"));
    const send = async (name, address, body) => {
      try { render(await sent(name, address, body)); } catch (error) { failed.push(error.message); }
    };
    for (const { path, file } of single) await send(last(path), `/api/file?name=${encodeURIComponent(last(path))}`, file);
    for (const [name, files] of bags) {
      const parts = files.filter(({ path }) => /(\.mcap|\.db3)$/i.test(path) || last(path) === METADATA);
      const sizes = JSON.stringify(parts.map(({ path, file }) => [last(path), file.size]));
      await send(last(name), `/api/bag?name=${encodeURIComponent(last(name))}&parts=${encodeURIComponent(sizes)}`, new Blob(parts.map(({ file }) => file)));
    }
    if (failed.length) say(failed.join("\n"));
  }
  // Sends a file with its progress; `fetch` does not report it.
  function sent(name, address, body) {
    const show = share => {
      const box = $("uploads");
      if (!box) return;
      box.hidden = share === null;
      box.firstChild.textContent = share < 1 ? `sending ${name}, ${(100 * share).toFixed(0)} % of ${(body.size / 2 ** 20).toPrecision(2)} MB ` : `reading ${name} `;
      box.lastChild.value = share;
    };
    return new Promise((done, failed) => {
      const request = new XMLHttpRequest();
      request.open("POST", address);
      request.setRequestHeader("x-token", token);
      request.responseType = "json";
      request.upload.onprogress = event => show(event.total ? event.loaded / event.total : 1);
      request.onload = () => { show(null); const { response } = request; response && !response.error ? done(response) : failed(new Error(response?.error || request.statusText || "the server has not answered")); };
      request.onerror = () => { show(null); failed(new Error(`${name}: the server has not answered`)); };
      show(0);
      request.send(body);
    });
  }
  for (const type of ["dragover", "drop"]) addEventListener(type, e => {
    e.preventDefault();
    document.querySelector(".drop")?.classList.toggle("over", type === "dragover");
    if (type === "drop" && e.dataTransfer.files.length) {
      if (step !== "data") go("data");
      const entries = [...e.dataTransfer.items].map(item => item.webkitGetAsEntry?.()).filter(entry => entry);
      if (entries.some(entry => entry.isDirectory)) inFolders(entries).then(upload, error => say(String(error)));
      else upload([...e.dataTransfer.files].map(file => ({ path: file.name, file })));
    }
  });

  // The files of dropped folders with their paths.
  async function inFolders(entries) {
    const files = [];
    for (const entry of entries) {
      if (entry.isDirectory) {
        const reader = entry.createReader();
        for (;;) {
          const some = await new Promise((done, failed) => reader.readEntries(done, failed));
          if (!some.length) break;
          files.push(...await inFolders(some));
        }
      } else {
        const file = await new Promise((done, failed) => entry.file(done, failed));
        files.push({ path: entry.fullPath.replace(/^\//, ""), file });
      }
    }
    return files;
  }

  $("cancel").onclick = () => act({ do: "cancel" });
  $("undo").onclick = () => act({ do: "undo" });
  listen();
})();
