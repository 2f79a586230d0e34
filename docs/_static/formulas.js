/* Draw the formulas of a page, which Sphinx leaves as \(…\) and \[…\], by the KaTeX that lies beside this file. */
const beside = new URL("katex/", document.currentScript.src);
const style = Object.assign(document.createElement("link"), { rel: "stylesheet", href: new URL("katex.min.css", beside) });
const script = Object.assign(document.createElement("script"), { src: new URL("katex.min.js", beside) });
script.onload = () => {
  for (const formula of document.querySelectorAll(".math")) {
    const text = formula.textContent.trim();
    katex.render(text.slice(2, -2), formula, { displayMode: text.startsWith("\\["), throwOnError: false });
  }
};
document.head.append(style, script);
