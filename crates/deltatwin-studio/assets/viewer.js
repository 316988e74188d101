// Rerun's web viewer with the file of the session; its time cursor and that of the page around it follow each other.
"use strict";
(async () => {
  const query = new URLSearchParams(location.search), said = document.getElementById("said");
  const TIMELINE = "time", CHANNEL = "session";
  // Time between looks at the viewer's cursor, ms; times of the viewer are in ns.
  const LOOK = 50, NANO = 1e9;
  const tell = message => parent.postMessage(message, location.origin);
  try {
    await wasm_bindgen({ module_or_path: "/re_viewer_bg.wasm" });
    const handle = new wasm_bindgen.WebHandle({
      url: [], hide_welcome_screen: true, enable_history: false, persist: false, notebook: false,
      render_backend: query.get("renderer") || undefined, theme: query.get("theme") || undefined,
    });
    await handle.start(document.getElementById("view"));
    const answer = await fetch("/api/rrd", { headers: { "x-token": query.get("token") || "" } });
    if (!answer.ok) throw new Error(await answer.text());
    handle.open_channel(CHANNEL, "session");
    handle.send_rrd_to_channel(CHANNEL, new Uint8Array(await answer.arrayBuffer()));
    handle.close_channel(CHANNEL);
    said.hidden = true;
    let known = null;
    setInterval(() => {
      if (handle.has_panicked()) { said.hidden = false; said.textContent = "The viewer has stopped; look at the file with the command beside."; return; }
      const id = handle.get_active_recording_id();
      const time = id ? handle.get_time_for_timeline(id, TIMELINE) : null;
      if (time === null || time === undefined || time === known) return;
      known = time;
      tell({ time: time / NANO });
    }, LOOK);
    addEventListener("message", event => {
      const id = handle.get_active_recording_id();
      if (event.origin !== location.origin || event.source !== parent || !id || !isFinite(event.data.time)) return;
      known = Math.round(event.data.time * NANO);
      handle.set_playing(id, false);
      handle.set_time_for_timeline(id, TIMELINE, known);
    });
    document.documentElement.dataset.ready = "1";
    tell({ ready: true });
  } catch (error) {
    said.textContent = `The viewer cannot be shown: ${error.message || error}`;
    tell({ failed: said.textContent });
  }
})();
