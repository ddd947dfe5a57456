#include "server/render/painter/scene_renderer.h"

#include <GL/osmesa.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>

#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

constexpr int kMoreShapes = 2000;  // of a scene beside its geoms; MuJoCo drops further ones
constexpr int kSamples = 4;        // multisampling: samples a pixel
// MuJoCo's own default of 4096 makes each picture 8 ms slower and looks the same.
constexpr int kShadowSize = 2048;

mjvCamera CameraOf(const mjModel& model) {
  mjvCamera camera;
  mjv_defaultCamera(&camera);
  const int tracking = mj_name2id(&model, mjOBJ_CAMERA, "track");
  if (tracking >= 0) {
    camera.type = mjCAMERA_FIXED;
    camera.fixedcamid = tracking;
    return camera;
  }
  camera.type = mjCAMERA_TRACKING;
  camera.trackbodyid = std::min(1, model.nbody - 1);
  camera.distance = 4;
  camera.elevation = -20;
  camera.azimuth = 90;
  return camera;
}

}  // namespace

// An OpenGL context. Pictures are drawn into a framebuffer object of the renderer; the context's
// own framebuffer is too small to matter.
class SceneRenderer::OffscreenContext {
 public:
  OffscreenContext() {
    constexpr std::array<int, 9> kAttributes = {OSMESA_FORMAT,
                                                OSMESA_RGBA,
                                                OSMESA_DEPTH_BITS,
                                                24,
                                                OSMESA_STENCIL_BITS,
                                                8,
                                                OSMESA_PROFILE,
                                                OSMESA_COMPAT_PROFILE,
                                                0};
    context_ = OSMesaCreateContextAttribs(kAttributes.data(), nullptr);
  }
  ~OffscreenContext() {
    if (context_ != nullptr) OSMesaDestroyContext(context_);
  }
  OffscreenContext(const OffscreenContext&) = delete;
  OffscreenContext& operator=(const OffscreenContext&) = delete;

  // False where Mesa gives no context.
  bool MakeCurrent() {
    return context_ != nullptr && OSMesaMakeCurrent(context_, own_frame_.data(), GL_UNSIGNED_BYTE,
                                                    kOwnSide, kOwnSide) == GL_TRUE;
  }

 private:
  static constexpr int kOwnSide = 16;
  std::array<uint8_t, 4 * kOwnSide * kOwnSide> own_frame_{};
  OSMesaContext context_ = nullptr;
};

void SceneRenderer::KeepShaders() {
  const Result<std::string> folder = MakeTemporaryFolder("b4mrl-painter");
  // Each of these counts only where the user has not set it.
  if (!folder.ok()) {
    setenv("MESA_SHADER_CACHE_DISABLE", "true", 0);
    return;
  }
  const FolderRemover remover(*folder);
  setenv("MESA_SHADER_CACHE_DIR", folder->c_str(), 0);
  setenv("MESA_DISK_CACHE_SINGLE_FILE", "true", 0);
  OffscreenContext().MakeCurrent();  // opens the files
}

SceneRenderer::SceneRenderer(uint32_t width, uint32_t height)
    : opengl_(std::make_unique<OffscreenContext>()),
      viewport_{0, 0, static_cast<int>(width), static_cast<int>(height)} {
  mjv_defaultScene(&scene_);
  mjr_defaultContext(&context_);
}

SceneRenderer::~SceneRenderer() {
  if (opengl_->MakeCurrent()) mjr_freeContext(&context_);
  mjv_freeScene(&scene_);
}

Result<std::unique_ptr<SceneRenderer>> SceneRenderer::Create(const mjModel& model, uint32_t width,
                                                             uint32_t height) {
  [[maybe_unused]] static const bool shaders_are_kept = (KeepShaders(), true);
  // The frame's size and quality are properties of the model. Its arrays are shared, not copied.
  mjModel sized = model;
  sized.vis.global.offwidth = static_cast<int>(width);
  sized.vis.global.offheight = static_cast<int>(height);
  sized.vis.quality.offsamples = kSamples;
  sized.vis.quality.shadowsize = std::min(sized.vis.quality.shadowsize, kShadowSize);
  std::unique_ptr<SceneRenderer> renderer(new SceneRenderer(width, height));
  if (!renderer->opengl_->MakeCurrent()) {
    return Status(StatusCode::kUnsupported, "Mesa gives no off-screen OpenGL context");
  }
  mjv_makeScene(&sized, &renderer->scene_, model.ngeom + kMoreShapes);
  mjr_makeContext(&sized, &renderer->context_, mjFONTSCALE_100);
  mjr_setBuffer(mjFB_OFFSCREEN, &renderer->context_);
  if (renderer->context_.currentBuffer != mjFB_OFFSCREEN) {
    return Status(StatusCode::kUnsupported,
                  fmt::format("Mesa gives no frame of {} x {} pixels", width, height));
  }
  return renderer;
}

void SceneRenderer::Draw(const mjModel& model, mjData& data, std::span<std::byte> picture) {
  opengl_->MakeCurrent();
  mjvCamera camera = CameraOf(model);
  mjvOption option;
  mjv_defaultOption(&option);
  mjv_updateScene(&model, &data, &option, nullptr, &camera, mjCAT_ALL, &scene_);
  // MuJoCo counts a shape without room among the warnings at which a simulation gives up.
  data.warning[mjWARN_VGEOMFULL].number = 0;
  mjr_render(viewport_, &scene_, &context_);
  auto* bytes = reinterpret_cast<unsigned char*>(picture.data());
  mjr_readPixels(bytes, nullptr, viewport_, &context_);
  // OpenGL's rows start at the bottom.
  const size_t row = size_t{3} * static_cast<size_t>(viewport_.width);
  for (int top = 0, bottom = viewport_.height - 1; top < bottom; ++top, --bottom) {
    std::swap_ranges(bytes + top * row, bytes + (top + 1) * row, bytes + bottom * row);
  }
}

}  // namespace b4mrl
