// SPDX-License-Identifier: GPL-3.0-or-later
// From Blender's camera matrices to the kernel's camera.
#pragma once

#include <array>

#include "kernel/camera.h"

namespace skytree {

using Matrix4 = std::array<double, 16>;  // row-major, column vectors

/// `projection` as OpenGL has it, perspective or orthographic with any shift. Width and height of
/// the view stay 1. Throws std::invalid_argument for matrices that are singular, not finite, or of
/// another kind.
CameraView make_camera(const Matrix4& camera_to_world, const Matrix4& projection);

}  // namespace skytree
