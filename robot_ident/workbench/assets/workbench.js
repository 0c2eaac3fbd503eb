// What the page does by itself: its look, what is chosen on it, which click was a real one, and asking how the work
// goes. Clicks don't wait for the server's answer to an earlier one, and are never taken for that of another button.
window.dash_clientside = window.dash_clientside || {};
(() => {
  const LOOK = "robot_ident_look";
  const BUSY = 300, IDLE = 1500; // ms after an answer until the next question
  const AT_ONCE = 2; // laid over at most
  const none = () => window.dash_clientside.no_update;

  const look = () =>
    localStorage.getItem(LOOK) || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const show = (shade) => {
    document.documentElement.dataset.look = shade;
    return shade;
  };
  show(look());

  // A callback also runs when buttons appear; then nothing has a value.
  let count = 0;
  const real = () => {
    const hit = window.dash_clientside.callback_context.triggered.find((one) => one.value);
    if (!hit) return null;
    const dot = hit.prop_id.lastIndexOf(".");
    const name = hit.prop_id.slice(0, dot);
    count += 1;
    return { of: name.startsWith("{") ? JSON.parse(name) : name, value: hit.value, count };
  };

  // A deed is taken from the click itself: a button that is redrawn in the same moment would take its click with it.
  document.addEventListener(
    "click",
    (event) => {
      const button = event.target.closest('button[id*=\'"do":\']');
      if (!button || button.disabled) return;
      count += 1;
      window.dash_clientside.set_props("pressed", { data: { of: JSON.parse(button.id), count } });
    },
    true
  );

  const each = (ids, of) => ids.map((id) => of(Object.values(id)[0]));
  const marks = (ids, chosen) => each(ids, (own) => String(own === chosen));

  // How the work goes is asked one question after the other, however long an answer takes.
  let known = null, timer = null, asking = false;
  const session = () => (location.pathname.match(/^\/(session_\d{1,6})$/) || [])[1];
  const later = (wait) => {
    clearTimeout(timer);
    timer = setTimeout(ask, wait);
  };
  const take = (now) => {
    if (JSON.stringify(now.stand) !== JSON.stringify(known)) {
      if (known && known.step !== now.stand.step) window.dash_clientside.set_props("overlays", { data: [] });
      window.dash_clientside.set_props("stand", { data: now.stand });
    }
    window.dash_clientside.set_props("task", { data: now.job });
  };
  const ask = async () => {
    const name = session(), before = known;
    if (!name || !before) return later(BUSY);
    asking = true;
    let wait = IDLE;
    try {
      const answer = await fetch(`/_now/${name}`, { cache: "no-store" });
      if (!answer.ok) throw new Error(answer.status);
      const now = await answer.json();
      // a click that was answered meanwhile knows better
      if (known === before && session() === name) take(now);
      if (now.job.state === "running") wait = BUSY;
    } catch (error) {
      const state = error.message === "403" ? "strange" : "silent";
      window.dash_clientside.set_props("task", { data: { state } });
    }
    asking = false;
    return later(wait);
  };
  later(BUSY);

  const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
  const told = (job) => {
    if (job.state === "silent")
      return "The workbench does not answer. Nothing is lost: start it again by robot_ident workbench, with the same --folder.";
    if (job.state === "strange")
      return "The workbench was started again, and answers to its new address alone. Nothing is lost: open the URL that it printed.";
    if (job.state === "running") return `${capital(job.words)}, ${Math.round(job.seconds)} s`;
    return job.words;
  };

  window.dash_clientside.workbench = {
    look: (clicks) => {
      if (clicks) localStorage.setItem(LOOK, look() === "dark" ? "light" : "dark");
      return show(look());
    },
    real: () => real() || none(),
    choose: () => {
      const hit = real();
      return hit ? Object.values(hit.of)[0] : none();
    },
    mark: (chosen, ids, focus) => marks(ids, chosen ?? focus ?? 0),
    toggle: (_clicks, overlays) => {
      const hit = real();
      if (!hit) return none();
      const key = hit.of.tick;
      return overlays.includes(key) ? overlays.filter((one) => one !== key) : [...overlays, key].slice(-AT_ONCE);
    },
    ticked: (overlays, ids) => each(ids, (own) => String(overlays.includes(own))),
    stood: (stand, before) => {
      known = stand || null;
      const running = Boolean(known && known.job[1] === "running");
      if (running && !asking) later(BUSY);
      return [running, before && !running ? "" : none()]; // that one has to wait is said no longer
    },
    job: (job) => {
      const now = job || { state: "idle", words: "", share: 0, trace: "" };
      const running = now.state === "running";
      const wrong = ["failed", "silent", "strange"].includes(now.state);
      return [
        !running,
        String(Math.round(100 * (now.share || 0))),
        told(now) || "",
        wrong ? "wrong" : "",
        !now.trace,
        now.trace || "",
      ];
    },
  };
})();
