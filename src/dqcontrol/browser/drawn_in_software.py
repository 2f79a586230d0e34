"""What the viewer's page is told before it begins, so that it is quick where no graphics card draws it."""

from __future__ import annotations

from typing import Any

# The viewer asks for smooth edges, which take half of each picture there, and has no option for it. What draws is known
# once the viewer itself has looked, with a first context that draws nothing.
_TOLD = b"""
<script>
(() => {
  const own = HTMLCanvasElement.prototype.getContext;
  let isSlow;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    const context = own.call(this, kind, isSlow ? { ...options, antialias: false } : options);
    if (isSlow === undefined && kind === "webgl2" && context) {
      const known = context.getExtension("WEBGL_debug_renderer_info");
      const name = known ? context.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
      isSlow = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    }
    return context;
  };
})();
</script>
"""
_HEAD = b"<head>"


def told(answer: Any) -> Any:
    """Return an answer of the viewer's server (``websockets.http11.Response``); of its page one that is told."""
    if answer is not None and _HEAD in answer.body:
        answer.body = answer.body.replace(_HEAD, _HEAD + _TOLD, 1)
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer
