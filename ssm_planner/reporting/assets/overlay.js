// Motions over each other, each in the colour and dash of its side until it ends.
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
