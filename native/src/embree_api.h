// SPDX-License-Identifier: GPL-3.0-or-later
// Embree's entry points, looked up by name in a library of our own.
//
// Linking would be simpler and wrong: Blender carries Embree 4 in its global scope, the dynamic
// linker would bind our Embree 3 calls to it, and every ray would miss without an error. So the
// library is opened with RTLD_LOCAL and RTLD_DEEPBIND and each function comes from dlsym; nothing
// in this project refers to an rtc symbol at link time.
#pragma once

#include <embree3/rtcore.h>

#include <atomic>
#include <memory>

namespace skytree {

#define SKYTREE_EMBREE_FUNCTIONS(X)  \
  X(NewDevice)                       \
  X(GetDeviceProperty)               \
  X(GetDeviceError)                  \
  X(NewScene)                        \
  X(ReleaseScene)                    \
  X(CommitScene)                     \
  X(SetSceneFlags)                   \
  X(SetSceneBuildQuality)            \
  X(SetSceneProgressMonitorFunction) \
  X(NewGeometry)                     \
  X(ReleaseGeometry)                 \
  X(CommitGeometry)                  \
  X(AttachGeometryByID)              \
  X(DetachGeometry)                  \
  X(SetSharedGeometryBuffer)         \
  X(SetGeometryInstancedScene)       \
  X(SetGeometryTransform)            \
  X(Intersect8)                      \
  X(Occluded8) X(Intersect16) X(Occluded16) X(NewBVH) X(ReleaseBVH) X(BuildBVH) X(ThreadLocalAlloc)

struct EmbreeApi {
#define SKYTREE_EMBREE_POINTER(name) decltype(&::rtc##name) name;
  SKYTREE_EMBREE_FUNCTIONS(SKYTREE_EMBREE_POINTER)
#undef SKYTREE_EMBREE_POINTER
  RTCDevice device;  // one for the process
};

/// Opens Embree on first use: $SKYTREE_EMBREE, then lib/ beside this module, then the system's.
/// Throws std::runtime_error that says what was tried and what to do.
const EmbreeApi& embree();

/// Throws the device's pending error of this thread, if any, as std::runtime_error that begins with
/// `doing`.
void check_embree(const char* doing);

struct ReleaseEmbreeScene {
  void operator()(RTCScene scene) const { embree().ReleaseScene(scene); }
};
struct ReleaseEmbreeGeometry {
  void operator()(RTCGeometry geometry) const { embree().ReleaseGeometry(geometry); }
};
using EmbreeScene = std::unique_ptr<RTCSceneTy, ReleaseEmbreeScene>;
using EmbreeGeometry = std::unique_ptr<RTCGeometryTy, ReleaseEmbreeGeometry>;

/// A scene with the flags that all of ours have.
EmbreeScene new_embree_scene();

/// Builds the tree. False if `cancel` became true meanwhile: the scene must then be thrown away.
bool commit_embree_scene(RTCScene scene, const std::atomic<bool>& cancel);

}  // namespace skytree
