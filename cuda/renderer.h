// SPDX-License-Identifier: GPL-3.0-or-later
// Renders on one GPU, pass by pass, for a RenderSession.
#pragma once

#include <memory>

#include "src/device_renderer.h"

namespace skytree::cuda {

/// Costs nothing until it renders: the driver is loaded and the GPU opened then, on the session's
/// thread, and what goes wrong there is told by render(). `ordinal` as in devices().
std::unique_ptr<DeviceRenderer> make_renderer(int ordinal);

}  // namespace skytree::cuda
