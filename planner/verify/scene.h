// Everything a moving tool can meet, looked at along the tool: the stock of this moment, the part
// to keep, the fixture. Judges one straight move at a time and lets it cut or deposit.
//
// Modes (DESIGN.md): in strict mode the bodies are tested against the stock of this moment and the
// fixture; in paper mode against V_R alone, and without fixture and idle tool. The stock is cut and
// filled the same in both. Part frame, mm.
// Limits: across, bodies are tested at columns one pitch apart (fixture: 0.25 mm); entries less
// than 0.05 mm deep are taken as touching.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "planner/verify/block_stock.h"
#include "planner/verify/bodies.h"
#include "planner/verify/findings.h"
#include "planner/verify/forward_kinematics.h"

namespace reforge::verify {

struct SceneSolids {
  const TriangleMesh* initial = nullptr;
  const TriangleMesh* target = nullptr;   // may be null: only bounds the grid
  const TriangleMesh* reused = nullptr;   // may be null: nothing to keep
  const TriangleMesh* fixture = nullptr;  // may be null
};

// Where in the program a judgement is made.
struct Place {
  std::size_t line = 0;
  int block = 0;
};

// One straight move at one rotary position.
struct SceneMove {
  Pose pose;
  Vec3 from, to;  // programmed point (cutter tip), machine frame
  bool rapid = false;
  bool module_open = false;
  bool spindle_on = false;
  double bead_width = 0;  // > 0: deposits
  double bead_height = 0;
};

class Scene {
 public:
  Scene(const SceneSolids& solids, const ToolBodies& tools, Mode mode, double pitch,
        double bridge_mm, Findings& findings);

  void move(const SceneMove& move, const Place& place);
  // The bead ended: what hangs is judged.
  void end_bead() { hanging_mm_ = 0; }
  // The last block's work goes into the stock.
  void finish();

  const Stock& stock() const { return stock_; }
  // Every direction milled from.
  const std::vector<Vec3>& milled_from() const { return milled_from_; }
  double pitch() const { return pitch_; }
  // Smallest gap met, per body and what it nearly touched ("holder to stock"); only gaps under 10
  // mm.
  const std::map<std::string, double>& clearances() const { return clearances_; }
  // Points that bound the part at any time: of initial, target, and what was printed.
  const std::vector<Vec3>& outline() {
    absorb_laid();
    return outline_;
  }

 private:
  struct Obstacle {
    Envelope* envelope;
    const char* name;
  };
  // A move in the view's frame.
  struct Local {
    Vec3 from, to;         // cutter tip
    Eigen::Matrix3d turn;  // machine -> view
    const SceneMove* move;
    const Place* place;
  };

  bool near_anything(const SceneMove& move);
  void absorb_laid();
  void look_along(const Vec3& direction);
  void check_body(const Body& body, Fault fault, const Local& local, const Obstacle& obstacle);
  void check_ball(Fault fault, double radius, const Local& local, const Obstacle& obstacle,
                  const char* sentence);
  void check_mouth(const Local& local, const Obstacle& obstacle);
  void mill(const Local& local);
  void print(const Local& local);
  void report(Fault fault, const Local& local, const Vec3& where, double depth,
              const std::string& sentence);

  SceneSolids solids_;
  const ToolBodies& tools_;
  Mode mode_;
  double pitch_;
  double bridge_mm_;
  Findings& findings_;
  Stock stock_;
  std::vector<Vec3> outline_;
  std::vector<Vec3> milled_from_;
  std::map<std::string, double> clearances_;
  Box3 laid_;              // beads of the present direction, part frame
  double hanging_mm_ = 0;  // of the present bead, without support so far

  Vec3 top_axis_ = Vec3::Zero();  // the direction top_ is for
  double top_ = 0;                // highest that anything may stand along it

  // Along the present direction.
  Vec3 direction_ = Vec3::Zero();
  std::unique_ptr<BlockStock> block_;
  std::unique_ptr<Envelope> reused_;
  std::unique_ptr<Envelope> fixture_;
};

}  // namespace reforge::verify
