#include "planner/verify/scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace reforge::verify {
namespace {

constexpr double kTouch = 0.05;         // mm: entries less deep are touching
constexpr double kClearanceMax = 10.0;  // mm: wider gaps are not told apart
constexpr double kMargin = 2.0;         // mm of grid around the part
constexpr double kFixturePitch = 0.25;
constexpr double kBeadStep = 0.6;  // mm of bead judged at a time

std::vector<Vec3> outline_of(const SceneSolids& solids) {
  std::vector<Vec3> points = solids.initial->vertices;
  if (solids.target) {
    points.insert(points.end(), solids.target->vertices.begin(), solids.target->vertices.end());
  }
  if (points.empty()) points.push_back(Vec3::Zero());
  return points;
}

// The lowest height within one cell: a wall may stand anywhere between two columns.
std::vector<float> guard_of(const Envelope& reused) {
  const View& view = reused.view();
  std::vector<float> guard(view.cells(), -std::numeric_limits<float>::infinity());
  for (int j = 1; j + 1 < view.nv; ++j) {
    for (int i = 1; i + 1 < view.nu; ++i) {
      float low = std::numeric_limits<float>::infinity();
      for (int b = j - 1; b <= j + 1; ++b) {
        for (int a = i - 1; a <= i + 1; ++a) low = std::min(low, reused.top(view.cell(a, b)));
      }
      guard[view.cell(i, j)] = low;
    }
  }
  return guard;
}

}  // namespace

Scene::Scene(const SceneSolids& solids, const ToolBodies& tools, Mode mode, double pitch,
             double bridge_mm, Findings& findings)
    : solids_(solids),
      tools_(tools),
      mode_(mode),
      pitch_(pitch),
      bridge_mm_(bridge_mm),
      findings_(findings),
      stock_(*solids.initial),
      outline_(outline_of(solids)) {}

void Scene::finish() {
  if (block_) block_->close(stock_);
  block_.reset();
  direction_ = top_axis_ = Vec3::Zero();
  absorb_laid();
}

// What was printed bounds the part from now on.
void Scene::absorb_laid() {
  if (laid_.isEmpty()) return;
  for (const auto corner :
       {Box3::BottomLeftFloor, Box3::BottomRightFloor, Box3::TopLeftFloor, Box3::TopRightFloor,
        Box3::BottomLeftCeil, Box3::BottomRightCeil, Box3::TopLeftCeil, Box3::TopRightCeil}) {
    outline_.push_back(laid_.corner(corner));
  }
  laid_.setEmpty();
}

void Scene::look_along(const Vec3& direction) {
  const Vec3 d = clean_direction(direction);
  if (block_ && (d - direction_).norm() < 1e-9) return;
  finish();
  direction_ = d;
  const View view = make_view(d, outline_, kMargin, pitch_);
  block_ = std::make_unique<BlockStock>(view, stock_.columns(view));
  reused_.reset();
  if (solids_.reused) {
    reused_ = std::make_unique<Envelope>(*solids_.reused, view);
    block_->set_guard(guard_of(*reused_));
  }
  fixture_.reset();
  if (mode_ == Mode::kStrict && solids_.fixture && !solids_.fixture->empty()) {
    fixture_ = std::make_unique<Envelope>(
        *solids_.fixture, make_view(d, solids_.fixture->vertices, kFixturePitch, kFixturePitch));
  }
}

// Whether any tool comes down to where anything may stand.
bool Scene::near_anything(const SceneMove& move) {
  const Vec3 axis = move.pose.tool_axis();
  if (axis != top_axis_) {
    absorb_laid();
    top_axis_ = axis;
    top_ = -std::numeric_limits<double>::infinity();
    for (const Vec3& p : outline_) top_ = std::max(top_, axis.dot(p));
    if (mode_ == Mode::kStrict && solids_.fixture) {
      for (const Vec3& p : solids_.fixture->vertices) top_ = std::max(top_, axis.dot(p));
    }
  }
  const double tip =
      std::min(axis.dot(move.pose.to_part(move.from)), axis.dot(move.pose.to_part(move.to)));
  const Body& nozzle = move.module_open ? tools_.nozzle_deployed : tools_.nozzle_parked;
  return std::min(tip, tip + nozzle.offset.z()) < top_ + 1.0;
}

void Scene::move(const SceneMove& move, const Place& place) {
  if (move.bead_width <= 0 && !near_anything(move)) return;
  look_along(move.pose.tool_axis());
  const View& view = block_->view();
  const Local local{view.to_view(move.pose.to_part(move.from)),
                    view.to_view(move.pose.to_part(move.to)), view.rotation * move.pose.turn, &move,
                    &place};
  if (move.module_open) {
    print(local);
  } else {
    mill(local);
  }
}

void Scene::report(Fault fault, const Local& local, const Vec3& where, double depth,
                   const std::string& sentence) {
  const Vec3 part = block_->view().to_part(where);
  findings_.add(fault, local.place->line, local.place->block, part, depth, [&] {
    return sentence + " by " + millimetres(depth) + " mm at X" + millimetres(part.x()) + " Y" +
           millimetres(part.y()) + " Z" + millimetres(part.z()) + " of the part";
  });
}

void Scene::check_body(const Body& body, Fault fault, const Local& local,
                       const Obstacle& obstacle) {
  const Vec3 offset = local.turn * body.offset;
  const std::string key = body.name + " to " + obstacle.name;
  const auto known = clearances_.find(key);
  double smallest = known == clearances_.end() ? kClearanceMax : known->second;
  double deepest = -kTouch;
  Vec3 where = Vec3::Zero();
  for (const Disc& disc : body.discs) {
    const Vec3 up(0, 0, disc.height);
    const SweptDisc swept{local.from + offset + up, local.to + offset + up, disc.radius};
    Vec3 at = Vec3::Zero();
    const double limit = std::max(smallest, -kTouch);
    const double gap = swept_gap(*obstacle.envelope, swept, limit, &at);
    if (gap >= limit) continue;
    smallest = std::min(smallest, gap);
    if (gap < deepest) deepest = gap, where = at;
  }
  if (smallest < kClearanceMax) clearances_[key] = smallest;
  if (deepest < -kTouch) {
    report(fault, local, where, -deepest, "the " + body.name + " enters the " + obstacle.name);
  }
}

void Scene::check_ball(Fault fault, double radius, const Local& local, const Obstacle& obstacle,
                       const char* sentence) {
  Vec3 where = Vec3::Zero();
  const double depth =
      obstacle.envelope->ball_depth(local.from, local.to, radius - kTouch, kTouch, &where);
  if (depth > kTouch) report(fault, local, where, depth, std::string(sentence) + obstacle.name);
}

void Scene::check_mouth(const Local& local, const Obstacle& obstacle) {
  const Vec3 offset = local.turn * tools_.nozzle_deployed.offset;
  Vec3 where = Vec3::Zero();
  const SweptDisc mouth{local.from + offset, local.to + offset, tools_.mouth_radius};
  const double gap = swept_gap(*obstacle.envelope, mouth, -kTouch, &where);
  if (gap < -kTouch) {
    report(Fault::kNozzleDrag, local, where, -gap,
           std::string("the nozzle's mouth drags through the ") + obstacle.name);
  }
}

void Scene::mill(const Local& local) {
  if (block_->depositing()) block_->close(stock_);
  const bool strict = mode_ == Mode::kStrict;
  const double r = tools_.ball_radius;
  const Obstacle stock{&block_->envelope(), "stock"};
  const Obstacle kept{reused_.get(), "part to keep"};
  const Obstacle fixture{fixture_.get(), "fixture"};
  const Obstacle& solid = strict ? stock : kept;
  const SceneMove& m = *local.move;

  bool cuts = !m.rapid;
  if (m.rapid) {
    cuts = block_->envelope().ball_depth(local.from, local.to, r, kTouch) > kTouch;
    if (cuts && solid.envelope) {
      check_ball(Fault::kRapidInMaterial, r, local, solid, "the cutter moves at G0 through the ");
    }
  } else if (!m.spindle_on) {
    check_ball(Fault::kSpindleOff, r, local, stock,
               "with the spindle stopped, or not yet at speed, the cutter enters the ");
  }
  if (solid.envelope) check_body(tools_.holder, Fault::kHolderCollision, local, solid);
  if (strict) {
    check_body(tools_.nozzle_parked, Fault::kIdleCollision, local, stock);
    if (fixture_) {
      check_ball(Fault::kCutterCollision, r, local, fixture, "the cutter enters the ");
      check_body(tools_.holder, Fault::kHolderCollision, local, fixture);
      check_body(tools_.nozzle_parked, Fault::kIdleCollision, local, fixture);
    }
  }
  if (!cuts) return;
  if (std::find(milled_from_.begin(), milled_from_.end(), direction_) == milled_from_.end()) {
    milled_from_.push_back(direction_);
  }
  const Gouge gouge = block_->cut(local.from, local.to, r, kTouch);
  if (gouge.depth > 0) {
    report(Fault::kGouge, local, gouge.where, gouge.depth,
           "the cutter goes below the part to keep");
  }
}

void Scene::print(const Local& local) {
  const bool strict = mode_ == Mode::kStrict;
  if (block_->cutting()) block_->close(stock_);
  const Obstacle stock{&block_->envelope(), "stock"};
  const Obstacle kept{reused_.get(), "part to keep"};
  const Obstacle fixture{fixture_.get(), "fixture"};
  const Obstacle& solid = strict ? stock : kept;
  if (solid.envelope) {
    check_body(tools_.nozzle_deployed, Fault::kNozzleCollision, local, solid);
    check_mouth(local, solid);
  }
  if (strict) {
    check_body(tools_.holder, Fault::kHolderCollision, local, stock);
    check_ball(Fault::kCutterCollision, tools_.ball_radius, local, stock,
               "while printing the cutter enters the ");
    if (fixture_) {
      check_body(tools_.nozzle_deployed, Fault::kNozzleCollision, local, fixture);
      check_body(tools_.holder, Fault::kHolderCollision, local, fixture);
      check_ball(Fault::kCutterCollision, tools_.ball_radius, local, fixture,
                 "while printing the cutter enters the ");
    }
  }
  const SceneMove& m = *local.move;
  if (m.bead_width <= 0) return;
  const Vec3 offset = local.turn * tools_.nozzle_deployed.offset;
  const Vec3 from = local.from + offset, to = local.to + offset;
  for (const Vec3& end : {from, to}) {
    laid_.extend(block_->view().to_part(end));
    top_ = std::max(top_, end.z());
  }
  const double length = (to - from).norm();
  const int pieces = std::max(1, static_cast<int>(std::ceil(length / kBeadStep)));
  for (int k = 0; k < pieces; ++k) {
    const Vec3 a = from + (to - from) * (static_cast<double>(k) / pieces);
    const Vec3 b = from + (to - from) * (static_cast<double>(k + 1) / pieces);
    const Bead bead = block_->deposit(a, b, m.bead_width, m.bead_height);
    if (bead.outside) {
      report(Fault::kDepositOutside, local, b, kMargin, "a bead leaves the part's surroundings");
    }
    if (bead.judged == 0) continue;
    if (bead.supported * 5 >= bead.judged) {
      hanging_mm_ = 0;
      continue;
    }
    hanging_mm_ += length / pieces;
    if (hanging_mm_ > bridge_mm_) {
      report(Fault::kUnsupported, local, b, hanging_mm_, "a bead runs with nothing beneath it");
    }
  }
}

}  // namespace reforge::verify
