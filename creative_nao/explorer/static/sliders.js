// A slider's role, name and value belong to the element that takes the focus, its thumb; the library puts them outside.
(() => {
  const moved = ["role", "aria-label", "aria-valuemin", "aria-valuemax", "aria-valuenow", "aria-orientation"];
  const hand = (slider) => {
    const thumb = slider.querySelector("[tabindex]");
    if (!thumb) return;
    for (const name of moved.filter((name) => slider.hasAttribute(name))) {
      thumb.setAttribute(name, slider.getAttribute(name));
      slider.removeAttribute(name);
    }
  };
  const all = () => document.querySelectorAll(".cn-slider").forEach(hand);
  new MutationObserver(all).observe(document.documentElement, {
    subtree: true, childList: true, attributes: true, attributeFilter: ["aria-valuenow"],
  });
  all();
})();
