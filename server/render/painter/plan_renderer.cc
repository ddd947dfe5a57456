#include "server/render/painter/plan_renderer.h"

#include <cairo/cairo.h>

#include <algorithm>
#include <memory>

namespace b4mrl {
namespace {

// Cairo's coordinates have 24 bits before the point; points beyond this bound are never visible.
constexpr double kFarOutPixels = 100'000;

struct CairoDeleter {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
  void operator()(cairo_t* context) const { cairo_destroy(context); }
};

void SetColour(cairo_t* context, Colour colour) {
  cairo_set_source_rgb(context, colour.red / 255.0, colour.green / 255.0, colour.blue / 255.0);
}

void CopyPixels(cairo_surface_t* surface, uint32_t width, uint32_t height,
                std::span<std::byte> picture) {
  cairo_surface_flush(surface);
  const unsigned char* data = cairo_image_surface_get_data(surface);
  const auto stride = static_cast<size_t>(cairo_image_surface_get_stride(surface));
  std::byte* out = picture.data();
  for (uint32_t y = 0; y < height; ++y) {
    const unsigned char* row = data + y * stride;
    for (uint32_t x = 0; x < width; ++x) {
      // CAIRO_FORMAT_RGB24 is a 32-bit 0x00RRGGBB, little-endian here.
      *out++ = std::byte{row[4 * x + 2]};
      *out++ = std::byte{row[4 * x + 1]};
      *out++ = std::byte{row[4 * x]};
    }
  }
}

}  // namespace

Status DrawPlanWithCairo(const PlanView& plan, uint32_t width, uint32_t height,
                         std::span<std::byte> picture) {
  const std::unique_ptr<cairo_surface_t, CairoDeleter> surface(cairo_image_surface_create(
      CAIRO_FORMAT_RGB24, static_cast<int>(width), static_cast<int>(height)));
  const std::unique_ptr<cairo_t, CairoDeleter> context(cairo_create(surface.get()));
  const double scale = width / plan.metres_wide;
  const auto pixel = [scale, far = kFarOutPixels](double metres, double origin, double anchor) {
    return std::clamp((metres - origin) * scale + anchor, -far, far);
  };
  SetColour(context.get(), plan.background);
  cairo_paint(context.get());
  for (const PlanPolygon& polygon : plan.polygons) {
    for (const PlanPoint& corner : polygon.corners) {
      cairo_line_to(context.get(), pixel(corner.x, plan.origin.x, plan.anchor.x * width),
                    pixel(corner.y, plan.origin.y, plan.anchor.y * height));
    }
    SetColour(context.get(), polygon.colour);
    cairo_fill(context.get());
  }
  if (cairo_status(context.get()) != CAIRO_STATUS_SUCCESS) {
    return Status(StatusCode::kUnavailable, "no memory for a picture");
  }
  CopyPixels(surface.get(), width, height, picture);
  return Status();
}

}  // namespace b4mrl
