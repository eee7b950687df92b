"use strict";
// Draws the plots that the page carries as JSON, exchanges what a picked one shows, and prepares them for print.
(async () => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const column = (values) =>
    values.some((value) => typeof value === "string") ? values : Float64Array.from(values, (value) => value ?? NaN);
  const columns = (found) => Object.fromEntries(Object.entries(found).map(([name, values]) => [name, column(values)]));
  const touch = matchMedia("(pointer: coarse)").matches;
  const views = new Map();

  // a finger that moves over a plot scrolls the page
  function letScroll(part) {
    if (part === null || typeof part !== "object") return;
    if (part.name === "Toolbar") part.attributes.active_drag = null;
    Object.values(part).forEach(letScroll);
  }

  async function draw(place) {
    const item = read(`${place.id}-item`);
    if (touch) letScroll(item);
    const view = (await Bokeh.embed.embed_item(item, place.id)).roots[0];
    views.set(place.id, view);
  }

  // what a select shows of each of its plots: pairs of a source and its columns
  function shownBy(select) {
    const group = document.getElementById(select.dataset.pick);
    const { data, notes } = read(`${group.id}-data`);
    const plots = [...group.querySelectorAll(".plot")].map((place) => {
      const parts = views.get(place.id).model.document;
      const pairs = Object.entries(data[select.value]).map(([name, found]) => [parts.get_model_by_name(name), found]);
      return [place, pairs.filter(([source]) => source !== null)];
    });
    return { group, plots, note: notes[select.value] ?? "" };
  }

  // of a protocol that a specimen was not tested by, there is nothing to see
  function hideEmpty(plots) {
    for (const [place, pairs] of plots)
      place.hidden = pairs.length > 0 && pairs.every(([, found]) => Object.values(found).every((each) => !each.length));
  }

  function pick(select) {
    const { group, plots, note } = shownBy(select);
    group.querySelector(".picked-note").textContent = note;
    hideEmpty(plots);
    for (const [source, found] of plots.flatMap(([, pairs]) => pairs))
      source.data = { ...source.data, ...columns(found) };
  }

  // a canvas keeps the width of the screen; on paper, a drawing takes its place that fits any width
  function toPaper() {
    for (const [id, view] of views) {
      const place = document.getElementById(id);
      if (place.hidden) continue;
      place.querySelector(".paper")?.remove();
      const svg = view.export("svg", false).ctx.get_svg();
      svg.setAttribute("viewBox", `0 0 ${svg.getAttribute("width")} ${svg.getAttribute("height")}`);
      svg.classList.add("paper");
      place.append(svg);
    }
  }

  function toScreen() {
    for (const drawing of document.querySelectorAll(".paper")) drawing.remove();
  }

  for (const place of document.querySelectorAll(".plot")) await draw(place);
  for (const select of document.querySelectorAll("[data-pick]")) {
    hideEmpty(shownBy(select).plots);
    select.addEventListener("change", () => pick(select));
  }
  addEventListener("beforeprint", toPaper);
  addEventListener("afterprint", toScreen);
  document.body.dataset.drawn = views.size;
})();
