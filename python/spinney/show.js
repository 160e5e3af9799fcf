// The page in a notebook: a frame that shows it, reads the file's bytes through the kernel, and
// returns the drawn polygon.

export default {
  render({ model, el }) {
    const frame = document.createElement("iframe");
    frame.style.cssText = `width: 100%; height: ${model.get("height")}px; border: 0`;
    const address = URL.createObjectURL(new Blob([model.get("_html")], { type: "text/html" }));
    frame.src = address;
    const take = ({ source, data }) => {
      if (source !== frame.contentWindow || !data?.spinney) return;
      const { range, start, end, polygon } = data.spinney;
      if (range !== undefined) model.send({ range, start, end });
      if (polygon) {
        model.set("_drawn", JSON.stringify(polygon, (_, value) => (typeof value === "bigint" ? Number(value) : value)));
        model.save_changes();
      }
    };
    const hand = ({ range, failure }, buffers) => {
      const [view] = buffers ?? [];
      const bytes = view ? new Uint8Array(view.buffer ?? view, view.byteOffset ?? 0, view.byteLength).slice().buffer : undefined;
      frame.contentWindow?.postMessage({ range, failure, bytes }, "*");
    };
    addEventListener("message", take);
    model.on("msg:custom", hand);
    el.append(frame);
    return () => {
      removeEventListener("message", take);
      model.off("msg:custom", hand);
      URL.revokeObjectURL(address);
    };
  },
};
