"""What the viewer's page is told before it begins, so that it is quick where no graphics card draws it."""

from __future__ import annotations

from typing import Any

# Drawn in software, smooth edges took 30 of 85 ms of a picture of a Panda. An empty canvas that lies above the scene,
# for rectangles that nobody here draws, took 7, and so did charts whose curves are drawn where the scene is.
_TOLD = b"""
<style>canvas[width="0"] { visibility: hidden }</style>
<script>
(() => {
  const own = HTMLCanvasElement.prototype.getContext;
  const quick = { webgl2: { antialias: false }, "2d": { willReadFrequently: true } };
  const inSoftware = () => {
    const context = own.call(document.createElement("canvas"), "webgl2");
    const known = context?.getExtension("WEBGL_debug_renderer_info");
    const name = known ? context.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
    return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
  };
  let isSlow;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    isSlow ??= inSoftware();
    return own.call(this, kind, isSlow ? { ...options, ...quick[kind] } : options);
  };
})();
</script>
"""
_HEAD = b"<head>"


def told(answer: Any) -> Any:
    """Return what the viewer's server answers (``websockets.http11.Response``); its page begins with what it is told."""
    if answer is not None and _HEAD in answer.body:
        answer.body = answer.body.replace(_HEAD, _HEAD + _TOLD, 1)
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer
