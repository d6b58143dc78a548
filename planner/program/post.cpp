#include "planner/program/post.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "planner/program/program_writer.h"
#include "planner/program/rotary_choice.h"

namespace reforge {
namespace {

constexpr double kSafetyOfSweep = 0.1;  // mm added to the swept sphere

Vec3 vec(const Point<MachineFrame>& p) {
  return {p.x, p.y, p.z};
}

std::string triple(const Point<MachineFrame>& p) {
  char text[96];
  std::snprintf(text, sizeof text, "X%.3f Y%.3f Z%.3f", p.x, p.y, p.z);
  return text;
}

std::string fixed(double value, int decimals) {
  char text[48];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

class Post {
 public:
  Post(const RigDescription& rig, const PostJob& job)
      : rig_(rig), job_(job), out_(rig.cnc, rig.kinematics.table) {
    double radius = 0;
    for (const TriangleMesh* solid : job.solids) {
      radius = std::max(radius, swept_radius(rig.kinematics, solid->vertices));
    }
    const double deployed_below = std::max(0.0, -rig.nozzle.deployed_offset_mm.z);
    safe_z_ = tilt_pivot(rig.kinematics).z + radius + kSafetyOfSweep + rig.clear_height_mm +
              deployed_below;
    safe_z_ = std::ceil(safe_z_ * 1000) / 1000;
  }

  Result<Program> run(const std::vector<BlockToolpath>& blocks) {
    out_.begin();
    header();
    out_.words("G21");
    out_.words("G90");
    out_.words("G94");
    out_.words("G17");
    out_.words("G54");
    for (const BlockToolpath& block : blocks) {
      if (const Status done = write(block); !done) return done.error();
    }
    close_block();
    close_module();
    out_.end();
    program_.lines = out_.lines();
    program_.text = out_.take();
    return std::move(program_);
  }

 private:
  void header() {
    const Kinematics& k = rig_.kinematics;
    const auto sign = [](int s) { return s > 0 ? "+1" : "-1"; };
    const bool paper = job_.mode == Mode::kPaper;
    const double ball = paper ? paper_cutter(rig_.cutter).diameter_mm : rig_.cutter.diameter_mm;
    out_.header("reforge-program", "1");
    out_.header("job", job_.name);
    out_.header("rig", rig_.name + " " + rig_.sha256);
    out_.header("mode", paper ? "paper" : "strict");
    out_.header("table", std::string(k.table == RotaryTable::kBC ? "BC" : "AC") + ", tilt " +
                             sign(k.sign_tilt) + ", c " + sign(k.sign_c));
    out_.header("pivot-r", triple(k.c_axis_point_mm));
    out_.header("pivot-d", triple(k.tilt_offset_mm));
    out_.header("g54", triple(k.g54_in_machine_mm));
    out_.header("cutter", "ball D" + fixed(ball, 3));
    out_.header("nozzle", "D" + fixed(rig_.nozzle.outlet_diameter_mm, 3) + " offset " +
                              triple(rig_.nozzle.deployed_offset_mm));
    out_.header("stock", job_.stock_sha256);
  }

  Status write(const BlockToolpath& block) {
    ++block_number_;
    const Vec3& d = block.frame.d;
    const std::string what = block.kind == BlockKind::kMill ? "mill" : "print";
    const auto choice = choose_angles(rig_, job_.mode, job_.solids, block, safe_z_, angles_);
    char name[8];
    std::snprintf(name, sizeof name, "%02d", block_number_);
    const std::string where = "block " + std::string(name) + " (" + what + " along " +
                              fixed(d.x(), 3) + ", " + fixed(d.y(), 3) + ", " + fixed(d.z(), 3) +
                              "): ";
    if (!choice) {
      return Status::fail(Code::kUnreachable,
                          where + "no rotary position within the travels points the tool that way");
    }
    if (!choice->objection.empty()) {
      if (job_.mode == Mode::kStrict)
        return Status::fail(Code::kUnreachable, where + choice->objection);
      program_.notes.push_back(where + choice->objection + "; paper mode does not count it");
    }
    close_block();
    if (block.kind == BlockKind::kMill) close_module();
    out_.comment("block " + std::string(name) + " " + what + " direction " + fixed(d.x(), 6) + " " +
                 fixed(d.y(), 6) + " " + fixed(d.z(), 6));
    out_.comment(work_of(block));
    figures_ = {};
    figures_.angles = angles_ = as_written(choice->angles);
    out_.rapid_z(safe_z_);
    out_.turn(angles_.tilt.in_degrees(), angles_.c.in_degrees());
    open(block.kind);
    shift_ = programmed_shift(rig_, block.kind);
    frame_ = block.frame;
    bool first = true;
    for (size_t p = 0; p < block.paths.size(); ++p) {
      const bool last = p + 1 == block.paths.size();
      out_.comment("path " + std::to_string(++path_number_));
      const Vec3* next = last ? nullptr : &block.paths[p + 1].moves.back().to;
      if (!last) {
        // Where the next path's work begins: its last rapid.
        for (const Move& move : block.paths[p + 1].moves) {
          if (move.motion == Motion::kRapid) next = &move.to;
        }
      }
      write(block.paths[p], block.kind, first, next);
      first = false;
    }
    figures_.paths = static_cast<int>(block.paths.size());
    program_.blocks.push_back(figures_);
    return Unit{};
  }

  // What the block is to do, in the part frame, for whoever reads the program back: length and
  // centroid of the path that cuts or deposits, and the volume of the beads.
  std::string work_of(const BlockToolpath& block) const {
    double length = 0;
    Vec3 moment = Vec3::Zero();
    for (const Path& path : block.paths) {
      for (size_t i = 1; i < path.moves.size(); ++i) {
        const Motion motion = path.moves[i].motion;
        if (motion == Motion::kRapid || motion == Motion::kCoast) continue;
        const Vec3 &a = path.moves[i - 1].to, &b = path.moves[i].to;
        length += (b - a).norm();
        moment += 0.5 * (b - a).norm() * (a + b);
      }
    }
    const Vec3 about = length > 0 ? block.frame.to_part(Vec3(moment / length)) : Vec3(Vec3::Zero());
    const double section = rig_.extrusion.bead_width_mm * rig_.extrusion.layer_height_mm;
    const double beads = block.kind == BlockKind::kPrint ? length * section : 0;
    return "work " + fixed(length, 3) + " about X" + fixed(about.x(), 6) + " Y" +
           fixed(about.y(), 6) + " Z" + fixed(about.z(), 6) + " beads " + fixed(beads, 3);
  }

  // The angles that stand in the text are the ones that coordinates are computed for.
  static RotaryAngles as_written(const RotaryAngles& angles) {
    const auto rounded = [](Radians angle) {
      return Radians::degrees(std::round(angle.in_degrees() * 1000) / 1000);
    };
    return {rounded(angles.tilt), rounded(angles.c)};
  }

  Point<MachineFrame> programmed(const Vec3& tip) const {
    const Vec3 j =
        vec(to_machine(rig_.kinematics, angles_, part_point(frame_.to_part(tip)))) + shift_;
    return {j.x(), j.y(), j.z()};
  }

  void open(BlockKind kind) {
    if (kind == BlockKind::kMill) {
      out_.words("M3 S" + number(rig_.cutter.spindle_rpm, 0));
      out_.dwell(rig_.spindle.spin_up_s);
      figures_.seconds += rig_.spindle.spin_up_s;
      spindle_on_ = true;
    } else if (!module_open_) {
      out_.module_code(70, 'S', rig_.extrusion.nozzle_temperature.value(), 1);
      module_open_ = true;
    }
  }

  void close_block() {
    if (block_number_ > 0 && !program_.blocks.empty()) out_.rapid_z(safe_z_);
    if (spindle_on_) out_.words("M5");
    spindle_on_ = false;
  }

  void close_module() {
    if (module_open_) out_.module_code(71);
    module_open_ = false;
  }

  void write(const Path& path, BlockKind kind, bool first_of_block, const Vec3* next) {
    Vec3 at = path.moves.front().to;
    bool extruding = false, extruded = false;
    for (size_t i = 0; i < path.moves.size(); ++i) {
      const Move& move = path.moves[i];
      const Point<MachineFrame> to = programmed(move.to);
      const double length = i == 0 ? 0 : (move.to - at).norm();
      if (move.motion == Motion::kRapid) {
        if (i == 0 && first_of_block) {
          out_.rapid_xy(to.x, to.y);
          out_.rapid_z(to.z);
        } else {
          out_.rapid(to);
        }
        figures_.air_mm += length;
        figures_.seconds += length / std::min(rig_.x.rapid_mm_per_s, rig_.z.rapid_mm_per_s);
      } else {
        const double feed = feed_of(path, move, at);
        if (move.motion == Motion::kDeposit && !extruding) {
          start_extrusion(feed);
          extruding = extruded = true;
        } else if (move.motion == Motion::kCoast && extruding) {
          out_.module_code(73);
          extruding = false;
        }
        if (move.motion == Motion::kDeposit)
          program_.filament_mm += length / feed * filament_speed(feed);
        out_.feed(to, feed);
        figures_.path_mm += length;
        figures_.seconds += length / feed;
      }
      at = move.to;
    }
    if (extruding) out_.module_code(73);
    if (kind == BlockKind::kPrint && extruded) end_bead(at, next);
  }

  // The block's feed, less where an axis could not follow.
  double feed_of(const Path& path, const Move& move, const Vec3& from) const {
    double feed = rig_.cutter.feed_mm_per_s;
    if (move.motion == Motion::kRamp || move.motion == Motion::kLower)
      feed = rig_.cutter.ramp_feed_mm_per_s;
    if (move.motion == Motion::kDeposit || move.motion == Motion::kCoast) {
      feed = path.feed_share * (path.first_layer ? rig_.extrusion.first_layer_feed_mm_per_s
                                                 : rig_.extrusion.feed_mm_per_s);
    }
    const Eigen::Matrix3d to_machine_axes = part_to_machine_rotation(rig_.kinematics, angles_);
    const Vec3 way = to_machine_axes * frame_.to_part(move.to - from);
    const double length = way.norm();
    const double most[] = {rig_.x.max_feed_mm_per_s, rig_.y.max_feed_mm_per_s,
                           rig_.z.max_feed_mm_per_s};
    for (int k = 0; k < 3; ++k) {
      if (std::abs(way[k]) > 1e-9) feed = std::min(feed, most[k] * length / std::abs(way[k]));
    }
    return std::floor(feed * 600) / 600;  // a tenth of a mm/min, rounded down
  }

  double filament_speed(double feed) const {
    const Extrusion& e = rig_.extrusion;
    const double section = std::numbers::pi * e.filament_diameter_mm * e.filament_diameter_mm / 4;
    return feed * e.bead_width_mm * e.layer_height_mm / section * e.multiplier;
  }

  void start_extrusion(double feed) {
    out_.module_code(72, 'P', filament_speed(feed));
    out_.dwell(rig_.extrusion.prime_dwell_s);
    program_.filament_mm += filament_speed(feed) * rig_.extrusion.prime_dwell_s;
    figures_.seconds += rig_.extrusion.prime_dwell_s;
    ++program_.toggles;
  }

  void end_bead(const Vec3& at, const Vec3* next) {
    if (next && (*next - at).head<2>().norm() <= rig_.extrusion.travel_without_retract_mm - 0.01)
      return;
    out_.module_code(74, 'P', rig_.extrusion.retract_mm);
    out_.module_code(75);
    figures_.seconds += rig_.extrusion.retract_mm / rig_.extrusion.retract_mm_per_s;
    ++program_.retracts;
  }

  const RigDescription& rig_;
  const PostJob& job_;
  ProgramWriter out_;
  Program program_;
  BlockFigures figures_;
  double safe_z_ = 0;
  RotaryAngles angles_;
  Frame frame_;
  Vec3 shift_ = Vec3::Zero();
  int block_number_ = 0;
  int path_number_ = 0;
  bool spindle_on_ = false;
  bool module_open_ = false;
};

}  // namespace

Result<Program> post_program(const RigDescription& rig, const PostJob& job,
                             const std::vector<BlockToolpath>& blocks) {
  return Post(rig, job).run(blocks);
}

}  // namespace reforge
