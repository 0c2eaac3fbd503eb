// The page's look: as the system has it, until a reader chooses; kept in this browser.
window.dash_clientside = window.dash_clientside || {};
(() => {
  const key = "robot_ident_look";
  const now = () =>
    localStorage.getItem(key) || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  const show = (shade) => {
    document.documentElement.dataset.look = shade;
    return shade;
  };
  show(now());
  window.dash_clientside.workbench = {
    look: (clicks) => {
      if (clicks) localStorage.setItem(key, now() === "dark" ? "light" : "dark");
      return show(now());
    },
  };
})();
