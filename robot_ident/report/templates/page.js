"use strict";
const root = document.documentElement;
const button = document.getElementById("shade");
const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");

function shade() {
  return root.dataset.shade || (prefersDark.matches ? "dark" : "light");
}

function relayout(name) {
  for (const plot of PLOTS) {
    const place = document.getElementById(plot.id);
    if (place.data) Plotly.relayout(place, plot.shades[name]);
  }
}

function show() {
  const dark = shade() === "dark";
  button.textContent = dark ? "light" : "dark";
  button.title = "show on a " + button.textContent + " page";
  button.setAttribute("aria-pressed", String(dark));
  relayout(shade());
}

button.addEventListener("click", () => {
  root.dataset.shade = shade() === "dark" ? "light" : "dark";
  show();
});
prefersDark.addEventListener("change", show);

// Paper is white, whatever the screen was.
window.addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
  relayout("light");
  for (const place of document.querySelectorAll(".plot[data-drawn]")) Plotly.Plots.resize(place);
});
window.addEventListener("afterprint", show);

// Sets `a.b[0].c` in an object, so that a plot is drawn once, in the right shade.
function put(target, path, value) {
  const keys = path.replace(/\[(\d+)\]/g, ".$1").split(".");
  const last = keys.pop();
  keys.reduce((at, key) => (at[key] ??= {}), target)[last] = value;
}

// Plots are drawn one after the other: the first screen does not wait for the last.
const draw = (plot) => {
  const place = document.getElementById(plot.id);
  if (place.data || place.dataset.begun) return;
  place.dataset.begun = "true";
  for (const [path, value] of Object.entries(plot.shades[shade()])) put(plot.layout, path, value);
  Plotly.newPlot(place, plot.data, plot.layout, CONFIG).then(() => { place.dataset.drawn = "true"; });
};

// plotly.js stands in the page as base64 of its gzip.
async function library() {
  const packed = Uint8Array.from(atob(document.getElementById("library").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
}

if (PLOTS.length) {
  library()
    .then(() => PLOTS.forEach((plot, index) => window.setTimeout(draw, 20 * index, plot)))
    .catch((error) => {
      for (const place of document.querySelectorAll(".plot")) place.textContent = place.getAttribute("aria-label");
      console.error("the plots can't be drawn by this browser: " + error);
    });
}
show();
