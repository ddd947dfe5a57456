// Where an Environment draws its state. An environment describes the scene, a Canvas turns the
// scene into pixels. Only the program b4mrl-render links an implementation of Canvas
// (server/render/painter): the daemon itself loads no graphics library.
//
// Thread rule: one thread, the one that made the canvas.
#pragma once

#include <cstdint>
#include <vector>

#include "proto/base/status.h"

// MuJoCo's mjModel and mjData.
struct mjModel_;
struct mjData_;

namespace b4mrl {

struct PlanPoint {
  double x = 0;  // m, to the right
  double y = 0;  // m, downwards
};

struct Colour {
  uint8_t red = 0;
  uint8_t green = 0;
  uint8_t blue = 0;
  bool operator==(const Colour&) const = default;
};

struct PlanPolygon {
  std::vector<PlanPoint> corners;
  Colour colour;
};

// A flat world from above: filled polygons, later ones over earlier ones.
struct PlanView {
  Colour background;
  PlanPoint origin;        // m, the point of the world that is drawn at `anchor`
  PlanPoint anchor;        // fraction of the picture's width and height, from its top left
  double metres_wide = 0;  // m, what the picture's width shows; heights have the same scale
  std::vector<PlanPolygon> polygons;
};

class Canvas {
 public:
  virtual ~Canvas() = default;

  // A MuJoCo scene, seen by the model's camera "track", or from the side of its first body where
  // the model has no camera "track". The positions in `data` that follow from qpos are up to date.
  virtual Status DrawModel(const mjModel_& model, mjData_& data) = 0;
  virtual Status DrawPlan(const PlanView& plan) = 0;
};

}  // namespace b4mrl
