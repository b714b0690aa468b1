// Wheel and two fingers on a map become one event, "mapzoom": how many times nearer, and round which of its pixels.
(() => {
  const SIZE = 600;
  const fingers = new Map();
  let apart = 0;
  let waiting = null;

  const tell = (map, clientX, clientY, factor) => {
    // Turns within a moment are one: the factors of all, round the last place.
    if (waiting && waiting.map === map) factor *= waiting.factor;
    else setTimeout(send, 70);
    waiting = { map, clientX, clientY, factor };
  };
  const send = () => {
    const { map, clientX, clientY, factor } = waiting;
    waiting = null;
    const box = map.getBoundingClientRect();
    const image_x = ((clientX - box.left) / box.width) * SIZE;
    const image_y = ((clientY - box.top) / box.height) * SIZE;
    const detail = { image_x, image_y, factor: Math.min(16, Math.max(1 / 16, factor)) };
    map.dispatchEvent(new CustomEvent("mapzoom", { detail }));
  };
  const mapOf = (event) => event.target.closest?.(".cn-map");
  const isWhole = () => !new URLSearchParams(location.search).has("view");

  document.addEventListener("wheel", (event) => {
    const map = mapOf(event);
    if (!map || (event.deltaY > 0 && isWhole() && !event.ctrlKey)) return; // the page scrolls on
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    const pinched = event.ctrlKey ? 6 : 1; // a touchpad's pinch comes as small turns with Ctrl
    tell(map, event.clientX, event.clientY, Math.exp(-event.deltaY * lines * pinched * 0.003));
  }, { passive: false });

  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.max(1, Math.hypot(a.x - b.x, a.y - b.y)) };
  };
  document.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch" || !mapOf(event)) return;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size !== 2) return;
    window.mapPinch = true;
    apart = spread().apart;
  }, true);
  document.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size !== 2) return;
    const now = spread();
    const map = document.elementFromPoint(now.x, now.y)?.closest(".cn-map");
    if (!map || Math.abs(Math.log(now.apart / apart)) < 0.05) return;
    tell(map, now.x, now.y, now.apart / apart);
    apart = now.apart;
  }, true);
  const lift = (event) => {
    fingers.delete(event.pointerId);
    if (!fingers.size) setTimeout(() => (window.mapPinch = false), 0);
  };
  document.addEventListener("pointerup", lift, true);
  document.addEventListener("pointercancel", lift, true);
})();
