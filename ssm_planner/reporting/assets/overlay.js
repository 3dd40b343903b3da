// Draw two motions in one plot. Each has the colour and the dash pattern of its side, and its curve ends with the motion.
"use strict";
SSM.overlay = (plots, data, channels, names) => {
  const times = channels[0].t;
  for (const panel of data.panels) {
    plots.add(panel, times, () => panel.sides.map((side) => ({
      label: names[side], colour: data.colours[side], dash: SSM.dashes[side], keyed: true,
      values: Array.from(channels[side][panel.channel], (x, i) => (times[i] <= data.ends[side] + 1e-9 ? x * panel.scale : null)),
    })));
  }
};
