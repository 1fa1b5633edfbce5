#include "report/page_assets.h"

namespace binrig {

const char* const page_style = R"css(
:root { --ink: #16202e; --soft: #5b6676; --line: #d9dee6; --paper: #ffffff; --wash: #f5f7fa;
  --good: #1d6b45; --bad: #a32d22; --open: #8a6100; --blue: #164e8a; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 "Inter", "Segoe UI", "Helvetica Neue", Arial, "Noto Sans", "DejaVu Sans", sans-serif; }
main { max-width: 1100px; margin: 0 auto; padding: 28px 24px 80px; counter-reset: figure table; }
header { border-bottom: 2px solid var(--ink); margin-bottom: 22px; padding-bottom: 14px; }
.brand { font-size: 12px; letter-spacing: .14em; text-transform: uppercase; color: var(--soft); }
h1 { font-size: 28px; line-height: 1.2; margin: 6px 0 4px; font-weight: 650; letter-spacing: -.01em; }
.subtitle { color: var(--soft); margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 20px; margin: 44px 0 12px; padding-top: 14px; border-top: 1px solid var(--line); font-weight: 650; }
h3 { font-size: 16px; margin: 28px 0 8px; font-weight: 650; }
p, li { max-width: 74ch; overflow-wrap: break-word; }
p { margin: 0 0 12px; }
dl.facts { display: grid; grid-template-columns: max-content 1fr; gap: 3px 20px; margin: 14px 0 0; font-size: 14px; }
dl.facts dt { color: var(--soft); }
dl.facts dd { margin: 0; overflow-wrap: anywhere; }
.verdict { border: 1px solid var(--line); border-left: 6px solid var(--soft); background: var(--wash);
  padding: 16px 20px; margin: 22px 0; border-radius: 3px; }
.verdict.good { border-left-color: var(--good); } .verdict.bad { border-left-color: var(--bad); }
.verdict.open { border-left-color: var(--open); }
.verdict strong { font-size: 19px; line-height: 1.35; display: block; font-weight: 650; }
.verdict ul { margin: 10px 0 0; padding-left: 20px; }
.note { border-left: 3px solid var(--line); padding: 2px 0 2px 14px; color: #3a4657; font-size: 15px; }
.code { background: var(--wash); border: 1px solid var(--line); border-radius: 3px; padding: 10px 14px; overflow-x: auto;
  font: 13.5px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; white-space: pre; }
.scroll { overflow-x: auto; margin: 12px 0 20px; }
table { border-collapse: collapse; font-size: 14px; line-height: 1.4; min-width: 50%;
  font-variant-numeric: tabular-nums lining-nums; }
caption { caption-side: top; text-align: left; color: var(--soft); padding-bottom: 7px; max-width: 90ch; }
caption::before { counter-increment: table; content: "Table " counter(table) ". "; color: var(--ink); font-weight: 600; }
th { text-align: left; font-weight: 600; border-bottom: 1.5px solid var(--ink); border-top: 1.5px solid var(--ink);
  padding: 6px 14px 6px 0; vertical-align: bottom; }
td:first-child { min-width: 8.5em; }
td { border-bottom: 1px solid var(--line); padding: 5px 14px 5px 0; vertical-align: top; }
tr:last-child td:first-child { min-width: 8.5em; }
td { border-bottom: 1.5px solid var(--ink); }
td.num, th.num { text-align: right; } td.num { white-space: nowrap; } th { max-width: 12em; }
td.good, td.bad, td.open { font-weight: 600; }
.good > .sign, td.good { color: var(--good); } .bad > .sign, td.bad { color: var(--bad); }
.open > .sign, td.open { color: var(--open); }
td.good::before { content: "\2713\00a0"; } td.bad::before { content: "\2717\00a0"; } td.open::before { content: "\25CB\00a0"; }
figure { margin: 18px 0 26px; }
figure img { display: block; max-width: 100%; height: auto; }
figcaption { color: #3a4657; font-size: 14px; line-height: 1.45; margin-top: 8px; max-width: 82ch; }
figcaption::before { counter-increment: figure; content: "Figure " counter(figure) ". "; color: var(--ink); font-weight: 600; }
.grid { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); gap: 4px 28px; }
.panels { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 300px), 1fr)); gap: 12px 18px; }
.panel { position: relative; min-width: 0; }
.panel .title { font-size: 14px; font-weight: 600; margin-bottom: 4px; }
.panel img { width: 100%; image-rendering: pixelated; border: 1px solid var(--line); cursor: crosshair; touch-action: pan-y; }
.bar { display: flex; align-items: center; gap: 10px; font-size: 13px; margin-top: 10px; max-width: 620px;
  font-variant-numeric: tabular-nums; }
.bar .ramp { flex: 1; position: relative; padding-bottom: 20px; }
.bar .ramp i { display: block; height: 12px; border: 1px solid var(--line); }
.bar .ramp span { position: absolute; top: 15px; transform: translateX(-50%); white-space: nowrap; color: #374151; }
.bar .unit { padding-bottom: 20px; color: #374151; }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: 13px; margin-top: 10px; }
.legend i { display: inline-block; width: 13px; height: 13px; border: 1px solid #8c9096; margin-right: 6px; vertical-align: -2px; }
.readout { font-size: 13px; color: var(--soft); min-height: 1.6em; margin-top: 6px; font-variant-numeric: tabular-nums; }
.tools { margin-top: 6px; display: flex; flex-wrap: wrap; gap: 8px 14px; align-items: center; font-size: 13px; }
.tools button { font: inherit; border: 1px solid #b7bfca; background: #fff; color: var(--ink); border-radius: 3px;
  padding: 3px 11px; cursor: pointer; }
.tools button:hover { background: var(--wash); }
.tools input[type=range] { flex: 1; min-width: 140px; max-width: 420px; accent-color: var(--blue); }
.panels.wiping { grid-template-columns: minmax(0, 720px); }
.panels.wiping .panel { grid-area: 1 / 1; } .panels.wiping .panel + .panel img { clip-path: inset(0 0 0 var(--wipe, 50%)); }
.panels.wiping .panel + .panel .title { text-align: right; }
.panels.wiping .panel + .panel { pointer-events: none; }
canvas.cloud { width: 100%; aspect-ratio: 520 / 420; display: block; border: 1px solid var(--line); cursor: grab;
  touch-action: none; background: #fff; }
.script .still { display: none; } .live { display: none; } .script .live { display: grid; } .script .live.tools { display: flex; }
details { border: 1px solid var(--line); border-radius: 3px; padding: 8px 16px; margin: 14px 0; }
summary { cursor: pointer; font-weight: 600; }
footer { margin-top: 50px; border-top: 1px solid var(--line); padding-top: 10px; font-size: 13px; color: var(--soft); }
@media (max-width: 600px) {
  main { padding: 16px 14px 50px; } h1 { font-size: 23px; } h2 { font-size: 18px; margin-top: 34px; }
  dl.facts { grid-template-columns: 1fr; gap: 0; } dl.facts dd { margin-bottom: 6px; } .verdict { padding: 12px 14px; }
  .verdict strong { font-size: 17px; } table { font-size: 13px; } td, th { padding-right: 10px; }
}
@media print {
  body { font-size: 10.5pt; } main { max-width: none; padding: 0; } .tools, .readout { display: none !important; }
  h2, h3 { break-after: avoid; } figure, table, .verdict { break-inside: avoid; }
  .panels { grid-template-columns: 1fr 1fr; }
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; } .scroll { overflow: visible; }
}
)css";

const char* const page_script = R"js(
(function () {
  "use strict";
  document.documentElement.classList.add("script");
  function number(x) {
    if (x === 0) return "0";
    return Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(2) : String(Number(x.toPrecision(4)));
  }
  // A colour is looked up in its scale: what is embedded is the picture alone, read to 1/254 of the scale.
  var lookups = {};
  function lookup(name) {
    if (!lookups[name]) {
      lookups[name] = {};
      binrigScales[name].forEach(function (hex, i) { lookups[name][parseInt(hex, 16)] = i; });
    }
    return lookups[name];
  }
  function pixels(img) {
    if (!img.binrigPixels) {
      var canvas = document.createElement("canvas");
      canvas.width = img.naturalWidth; canvas.height = img.naturalHeight;
      var context = canvas.getContext("2d");
      context.drawImage(img, 0, 0);
      img.binrigPixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
    }
    return img.binrigPixels;
  }
  function colourAt(img, x, y) {
    var d = pixels(img), k = 4 * (y * img.naturalWidth + x);
    return d[k] * 65536 + d[k + 1] * 256 + d[k + 2];
  }
  function describe(figure, img, x, y) {
    if (x >= img.naturalWidth || y >= img.naturalHeight) return "outside";
    var colour = colourAt(img, x, y);
    if (figure.dataset.labels) {
      var labels = JSON.parse(figure.dataset.labels);
      return labels[colour] || "no value";
    }
    var low = Number(figure.dataset.low), high = Number(figure.dataset.high);
    var i = lookup(figure.dataset.scale)[colour];
    if (i === undefined) return "no value";
    var text = number(low + (high - low) * i / 255) + " " + figure.dataset.unit;
    return i === 0 ? "\u2264 " + text : i === binrigScales[figure.dataset.scale].length - 1 ? "\u2265 " + text : text;
  }
  document.querySelectorAll("figure.map").forEach(function (figure) {
    var images = Array.prototype.slice.call(figure.querySelectorAll(".panel img"));
    var readout = figure.querySelector(".readout"), rest = readout.textContent;
    function show(event) {
      var img = event.currentTarget, box = img.getBoundingClientRect();
      var x = Math.floor((event.clientX - box.left) / box.width * img.naturalWidth);
      var y = Math.floor((event.clientY - box.top) / box.height * img.naturalHeight);
      if (x < 0 || y < 0 || x >= img.naturalWidth || y >= img.naturalHeight) return;
      var step = Number(img.dataset.step);
      var u = Number(figure.dataset.u) + x * step, v = Number(figure.dataset.v) + y * step;
      readout.textContent = "u " + u + ", v " + v + " px:  " + images.map(function (other) {
        return (other.dataset.title ? other.dataset.title + " " : "") + describe(figure, other, x, y);
      }).join("  \u00b7  ");
    }
    images.forEach(function (img) {
      img.addEventListener("pointermove", show);
      img.addEventListener("pointerdown", show);
      img.addEventListener("pointerleave", function (e) { if (e.pointerType === "mouse") readout.textContent = rest; });
    });
    var panels = figure.querySelector(".panels"), button = figure.querySelector("button.wipe");
    if (!button) return;
    var slider = figure.querySelector("input[type=range]");
    slider.style.display = "none";
    button.addEventListener("click", function () {
      var on = panels.classList.toggle("wiping");
      button.textContent = on ? "side by side" : "lay over each other";
      slider.style.display = on ? "" : "none";
    });
    slider.addEventListener("input", function () { panels.style.setProperty("--wipe", slider.value + "%"); });
  });

  function bytes(text) {
    var raw = atob(text), out = new Uint8Array(raw.length);
    for (var i = 0; i < raw.length; ++i) out[i] = raw.charCodeAt(i);
    return out;
  }
  document.querySelectorAll("figure.clouds").forEach(function (figure) {
    var colours = binrigScales[figure.dataset.scale].map(function (hex) { return parseInt(hex, 16); });
    var first = { yaw: Number(figure.dataset.yaw), pitch: Number(figure.dataset.pitch), zoom: 1 };
    var view = Object.assign({}, first), pending = false;
    var clouds = Array.prototype.map.call(figure.querySelectorAll("canvas.cloud"), function (canvas) {
      return { canvas: canvas, xyz: new Int16Array(bytes(canvas.dataset.xyz).buffer), colour: bytes(canvas.dataset.colour) };
    });
    function draw(cloud) {
      var canvas = cloud.canvas, density = Math.min(2, window.devicePixelRatio || 1);
      var width = Math.round(canvas.clientWidth * density), height = Math.round(canvas.clientHeight * density);
      if (!width || !height) return;
      if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
      var context = canvas.getContext("2d"), image = context.createImageData(width, height);
      var out = new Uint32Array(image.data.buffer).fill(0xffffffff), nearest = new Float32Array(width * height).fill(1e9);
      var cy = Math.cos(view.yaw), sy = Math.sin(view.yaw), cp = Math.cos(view.pitch), sp = Math.sin(view.pitch);
      var n = cloud.colour.length, size = Math.min(9, Math.max(2, Math.round(0.95 * width * view.zoom / Math.sqrt(n))));
      for (var k = 0; k < n; ++k) {
        var x = cloud.xyz[3 * k] / 32000, y = cloud.xyz[3 * k + 1] / 32000, z = cloud.xyz[3 * k + 2] / 32000;
        var x1 = cy * x + sy * z, z1 = cy * z - sy * x, y2 = cp * y - sp * z1, z2 = sp * y + cp * z1;
        var scale = 0.46 * width * view.zoom / (1 + 0.22 * z2);
        var u = Math.floor(width / 2 + scale * x1), v = Math.floor(height / 2 + scale * y2), c = colours[cloud.colour[k]];
        var paint = 0xff000000 | (c & 255) << 16 | (c & 0xff00) | c >> 16;
        for (var b = v; b < v + size; ++b) {
          if (b < 0 || b >= height) continue;
          for (var a = u; a < u + size; ++a) {
            if (a < 0 || a >= width || z2 >= nearest[b * width + a]) continue;
            nearest[b * width + a] = z2; out[b * width + a] = paint;
          }
        }
      }
      context.putImageData(image, 0, 0);
    }
    function redraw() {
      if (pending) return;
      pending = true;
      requestAnimationFrame(function () { pending = false; clouds.forEach(draw); });
    }
    clouds.forEach(function (cloud) {
      var from = null;
      cloud.canvas.addEventListener("pointerdown", function (e) {
        from = { x: e.clientX, y: e.clientY }; cloud.canvas.setPointerCapture(e.pointerId);
      });
      cloud.canvas.addEventListener("pointermove", function (e) {
        if (!from) return;
        view.yaw += (e.clientX - from.x) * 0.01; view.pitch += (e.clientY - from.y) * 0.01;
        from = { x: e.clientX, y: e.clientY }; redraw();
      });
      ["pointerup", "pointercancel"].forEach(function (n) { cloud.canvas.addEventListener(n, function () { from = null; }); });
    });
    figure.querySelectorAll("button[data-zoom]").forEach(function (button) {
      button.addEventListener("click", function () {
        var zoom = Number(button.dataset.zoom);
        if (zoom) view.zoom = Math.min(12, Math.max(0.4, view.zoom * zoom)); else Object.assign(view, first);
        redraw();
      });
    });
    window.addEventListener("resize", redraw);
    redraw();
  });
  window.addEventListener("beforeprint", function () {
    document.querySelectorAll("details").forEach(function (d) { d.open = true; });
  });
})();
)js";

}  // namespace binrig
