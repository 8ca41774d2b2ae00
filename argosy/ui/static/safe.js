// No text of anybody's ever becomes markup: browsers that know Trusted Types refuse whatever this policy does not return.
// Leaflet tries at its start whether SVG works, and empties elements: nothing else is let through.
if (window.trustedTypes) {
  window.trustedTypes.createPolicy("default", {
    createHTML: (text) => (text === "<svg/>" || text === "" ? text : null),
  });
}
