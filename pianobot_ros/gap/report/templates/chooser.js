"use strict";
(() => {
  const traces = JSON.parse(document.getElementById("traces").textContent);
  const signal = document.getElementById("signal"), block = document.getElementById("block");
  const chosen = document.getElementById("chosen"), values = document.getElementById("values");
  const kinds = [["before", "twin before"], ["refit", "refitted"], ["after", "twin after"],
    ["real", "measured"]];
  const H = 300, B = 28;
  let W = 1040;
  chosen.innerHTML = "<svg></svg>";
  const NS = chosen.firstChild.namespaceURI;
  const make = (name, set, text) => {
    const node = document.createElementNS(NS, name);
    for (const key in set) node.setAttribute(key, set[key]);
    if (text !== undefined) node.textContent = text;
    return node;
  };
  const short = (v) => v === null || v === undefined ? "–" : String(+v.toPrecision(4));
  const option = (list, value, text) => {
    const node = document.createElement("option");
    node.value = value; node.textContent = text; list.append(node);
  };
  const ticks = (low, high, count) => {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw), out = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) out.push(k * step);
    return out;
  };
  function draw() {
    const trace = traces[block.value], all = kinds.flatMap(([k]) => trace[k]).filter((v) => v !== null);
    let low = Math.min(...all), high = Math.max(...all);
    if (!(high > low)) { low -= 1; high += 1; }
    const end = trace.t[trace.t.length - 1] || 1, levels = ticks(low, high, 5);
    const level = (v) => `${short(v)} ${trace.unit}`;
    const L = 12 + 6.5 * Math.max(...levels.map((v) => level(v).length));
    W = chosen.clientWidth || W;  // so that words keep their size
    const x = (t) => L + (W - L - 8) * t / end, y = (v) => 8 + (H - B - 8) * (high - v) / (high - low);
    const last = trace.t.length - 1;
    const svg = make("svg", { viewBox: `0 0 ${W} ${H}`, class: "chart wide", role: "slider", tabindex: 0,
      "aria-label": `${trace.signal} over time: measured and twin; arrow keys go along the curves`,
      "aria-valuemin": 0, "aria-valuemax": short(end), "aria-valuenow": 0 });
    for (const v of levels) {
      svg.append(make("line", { x1: L, x2: W - 8, y1: y(v), y2: y(v), class: "grid" }),
        make("text", { x: L - 6, y: y(v) + 4, "text-anchor": "end", class: "tick" }, level(v)));
    }
    for (const t of ticks(0, end, Math.min(5, W / 80))) {
      svg.append(make("text", { x: x(t), y: H - 10, "text-anchor": "middle", class: "tick" }, `${short(t)} s`));
    }
    for (const [kind] of kinds) {
      let d = "", pen = "M";
      trace[kind].forEach((v, i) => {
        if (v === null) { pen = "M"; return; }
        d += `${pen}${x(trace.t[i]).toFixed(1)} ${y(v).toFixed(1)}`; pen = "L";
      });
      svg.append(make("path", { d, class: kind }));
    }
    const hair = make("line", { y1: 8, y2: H - B, class: "mark", visibility: "hidden" });
    svg.append(hair);
    const read = (i) => {
      values.textContent = "";
      const say = (style, text) => {
        const span = document.createElement("span"), mark = document.createElement("i");
        mark.className = `swatch ${style}`; span.append(mark, text); values.append(span);
      };
      for (const [kind, label] of [...kinds].reverse()) {
        say(kind, i === null ? label : `${label} ${short(trace[kind][i])} ${trace.unit}`);
      }
      const span = document.createElement("span");
      span.textContent = i === null ? `floor ± ${short(trace.floor)} ${trace.unit}` : `at ${short(trace.t[i])} s`;
      values.append(span);
    };
    let here = 0;
    const look = (i) => {
      here = i;
      hair.setAttribute("x1", x(trace.t[i])); hair.setAttribute("x2", x(trace.t[i]));
      hair.setAttribute("visibility", "visible");
      read(i);
      svg.setAttribute("aria-valuenow", short(trace.t[i]));
      svg.setAttribute("aria-valuetext", [...values.children].map((e) => e.textContent).join(", "));
    };
    const leave = () => { hair.setAttribute("visibility", "hidden"); read(null); };
    svg.addEventListener("pointermove", (event) => {
      const box = svg.getBoundingClientRect();
      const t = ((event.clientX - box.left) / box.width * W - L) / (W - L - 8) * end;
      const i = trace.t.findIndex((v) => v >= t);
      look(i < 0 ? last : i);
    });
    svg.addEventListener("keydown", (event) => {
      const far = Math.max(1, Math.round(last / 10));
      const to = { ArrowLeft: here - 1, ArrowDown: here - 1, ArrowRight: here + 1, ArrowUp: here + 1,
        PageDown: here - far, PageUp: here + far, Home: 0, End: last }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      look(Math.min(last, Math.max(0, to)));
    });
    svg.addEventListener("focus", () => look(here));
    svg.addEventListener("blur", leave);
    svg.addEventListener("pointerleave", leave);
    chosen.replaceChildren(svg);
    read(null);
  }
  function blocks() {
    block.textContent = "";
    traces.forEach((t, i) => {
      if (t.signal === signal.value) option(block, i, t.condition && t.condition !== t.block ? `${t.block} · ${t.condition}` : t.block);
    });
    draw();
  }
  for (const name of new Set(traces.map((t) => t.signal))) option(signal, name, name);
  signal.addEventListener("change", blocks);
  block.addEventListener("change", draw);
  if (traces.length) {
    blocks();
    new ResizeObserver(() => { if (chosen.clientWidth !== W) draw(); }).observe(chosen);
  }
})();
