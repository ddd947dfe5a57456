// MuJoCo scenes to pixels, with Mesa's software rasteriser (OSMesa): needs neither display nor GPU.
//
// Each renderer has an OpenGL context of its own, because MuJoCo leaves lights and textures behind
// in a context, which would show in the pictures of another model. All renderers are created, used
// and destroyed on one thread. Mesa runs on that thread alone unless LP_NUM_THREADS says otherwise.
// Cost at 480 x 480 in processor time: 0.9 s for the first picture of a process, whose shaders have
// to be compiled, 0.3 s for a further renderer's first, and 27 ms for each later one, most of it
// the floor's reflection and 4 samples a pixel.
#pragma once

#include <mujoco/mujoco.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "proto/base/status.h"

namespace b4mrl {

class SceneRenderer {
 public:
  // A renderer for pictures of `model`, of at most limits::kMaxPictureSide pixels a side.
  // kUnsupported where Mesa gives no context or no frame of this size.
  static Result<std::unique_ptr<SceneRenderer>> Create(const mjModel& model, uint32_t width,
                                                       uint32_t height);
  ~SceneRenderer();
  SceneRenderer(const SceneRenderer&) = delete;
  SceneRenderer& operator=(const SceneRenderer&) = delete;

  // `model` has the meshes and textures of the model given to Create; sizes and positions of other
  // geoms may differ. `picture` has 3 * width * height bytes.
  void Draw(const mjModel& model, mjData& data, std::span<std::byte> picture);

 private:
  class OffscreenContext;
  // Has Mesa keep the machine code of shaders, which is most of the work for a renderer's first
  // picture, so that later renderers need not compile it again. Mesa keeps it in files alone: they
  // are this process's, and have no name any more when this returns, so that nothing is left behind
  // and no code that others wrote is executed.
  static void KeepShaders();
  SceneRenderer(uint32_t width, uint32_t height);

  std::unique_ptr<OffscreenContext> opengl_;
  mjrRect viewport_;
  mjvScene scene_;
  mjrContext context_;
};

}  // namespace b4mrl
