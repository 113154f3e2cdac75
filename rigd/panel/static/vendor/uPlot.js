// uPlot, which the script of index.html has loaded, as a module.

export default globalThis.uPlot;
