"""Contrast of every text of a page with what is behind it, light and dark, after WCAG 2.2 (1.4.3): at least 4.5, 3 if it is large.

    pip install playwright
    python benches/pages/contrast.py report.html plan.html …

Prints what is below, and ends with status 1 if there is any. Texts in canvases (the numbers on the axes) have the colours of
`--quiet` on `--paper`, which are judged with the others.
"""

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

CHROMIUM = "/usr/bin/chromium"
SCRIPT = r"""
() => {
  const parse = c => { const m = c.match(/[\d.]+/g); return m ? m.map(Number) : null; };
  const over = (a, b) => { const t = a[3] === undefined ? 1 : a[3]; return [0, 1, 2].map(k => a[k] * t + b[k] * (1 - t)); };
  const lum = c => { const f = c.slice(0, 3).map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4); return .2126 * f[0] + .7152 * f[1] + .0722 * f[2]; };
  const ratio = (a, b) => { const [x, y] = [lum(a), lum(b)].sort((p, q) => q - p); return (x + .05) / (y + .05); };
  const paper = () => parse(getComputedStyle(document.body).backgroundColor);
  const behind = e => {
    const layers = [];
    for (let n = e; n; n = n.parentElement) { const c = parse(getComputedStyle(n).backgroundColor); if (c && c[3] !== 0) { layers.push(c); if (c[3] === undefined || c[3] === 1) break; } }
    return layers.reverse().reduce((below, layer) => over(layer, below), paper());
  };
  // In a drawing, what lies behind is the last filled shape before the text that contains its middle.
  const drawn = t => {
    const box = t.getBoundingClientRect(), x = box.left + box.width / 2, y = box.top + box.height / 2, svg = t.closest("svg");
    let found = behind(svg);
    for (const s of svg.querySelectorAll("rect, polygon, path, circle, text")) {
      if (s === t) break;
      const style = getComputedStyle(s), c = parse(style.fill);
      if (s.tagName === "text" || !c || style.fill === "none") continue;
      const r = s.getBoundingClientRect();
      if (x < r.left || x > r.right || y < r.top || y > r.bottom) continue;
      const alpha = +style.fillOpacity * +style.opacity * (c[3] === undefined ? 1 : c[3]);
      found = over([...c.slice(0, 3), alpha], found);
    }
    return found;
  };
  const out = [];
  const judge = (text, color, back, size, weight, what) => {
    const least = size >= 24 || (size >= 18.66 && weight >= 700) ? 3 : 4.5, r = ratio(over(color, back), back);
    if (r < least) out.push([r.toFixed(2), least, text.trim().slice(0, 40), what, color.slice(0, 3).join(","), back.map(Math.round).join(",")].join(" | "));
    return 1;
  };
  let count = 0;
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let n = walk.nextNode(); n; n = walk.nextNode()) {
    const e = n.parentElement;
    if (!n.textContent.trim() || e.closest("script, style, noscript, title") || !e.getClientRects().length) continue;
    const s = getComputedStyle(e);
    if (s.visibility === "hidden" || +s.opacity === 0) continue;
    const svg = e.closest("svg");
    const color = parse(svg ? s.fill : s.color);
    if (color) count += judge(n.textContent, color, svg ? drawn(e) : behind(e), parseFloat(s.fontSize), +s.fontWeight, svg ? "drawing" : e.tagName + "." + e.className);
  }
  const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const hex = c => c.startsWith("#") ? (c.length === 4 ? [...c.slice(1)].map(d => parseInt(d + d, 16)) : [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16))) : parse(c);
  if (css("--quiet")) judge("numbers on the axes", hex(css("--quiet")), paper(), 11, 400, "canvas");
  // Curves need 3 against the paper (1.4.11).
  for (const name of ["--nominal", "--identified", "--earlier", "--added", "--measured", "--noise", "--axis-1", "--axis-2", "--axis-3", "--axis-4"]) if (css(name)) { const r = ratio(hex(css(name)), paper()); if (r < 3) out.push(`${r.toFixed(2)} | 3 | curve ${name}`); }
  return [count, out];
}
"""


def main() -> int:
    bad = 0
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for name in sys.argv[1:]:
            for scheme in ("light", "dark"):
                page = browser.new_page(viewport={"width": 1200, "height": 900}, color_scheme=scheme)
                page.goto(name if "://" in name else Path(name).resolve().as_uri())
                page.wait_for_timeout(800)
                count, below = page.evaluate(SCRIPT)
                print(f"{name} {scheme}: {count} texts, {len(below)} below")
                for line in sorted(set(below))[:12]:
                    print("   ", line)
                bad += len(below)
                page.close()
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
