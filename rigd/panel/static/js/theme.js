// Day or night: the system's choice unless a person chose otherwise. Runs before the first paint.
(() => {
  "use strict";
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");

  function read() {
    try {
      return localStorage.getItem("theme") ?? "auto";
    } catch {
      return "auto"; // storage is switched off: the choice holds until the page is loaded again
    }
  }

  let chosen = read();
  function apply() {
    root.dataset.theme = chosen === "auto" ? (dark.matches ? "dark" : "light") : chosen;
    window.dispatchEvent(new Event("themechange"));
  }

  window.rigdTheme = {
    get chosen() { return chosen; },
    /** @param {string} theme */
    choose(theme) {
      chosen = theme;
      try {
        localStorage.setItem("theme", theme);
      } catch { /* as above */ }
      apply();
    },
  };
  dark.addEventListener("change", apply);
  apply();
})();
