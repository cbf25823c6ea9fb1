// SPDX-License-Identifier: GPL-3.0-or-later
// The extension module behind skytree_core: thin, each part bound in a file of its own.
#include "bindings.h"

PYBIND11_MODULE(_native, m) {
  m.doc() = "Native core of Skytree; use it through the package skytree_core.";
  skytree::bind_devices(m);
  skytree::bind_samplers(m);
  skytree::bind_compressed_map(m);
  skytree::bind_brdf(m);
  skytree::bind_related(m);
  skytree::bind_render(m);
}
