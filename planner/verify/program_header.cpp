#include "planner/verify/program_header.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace reforge::verify {
namespace {

// "X1.0 Y2.0 Z3.0"
std::optional<Vec3> triple(const std::string& text) {
  Vec3 v;
  char rest = 0;
  if (std::sscanf(text.c_str(), "X%lf Y%lf Z%lf %c", &v.x(), &v.y(), &v.z(), &rest) == 3) return v;
  return std::nullopt;
}

bool near(const Point<MachineFrame>& p, const Vec3& v) {
  return (Vec3(p.x, p.y, p.z) - v).cwiseAbs().maxCoeff() <= 0.0006;
}

}  // namespace

void ProgramHeader::take(const gcode::Line& line) {
  if (!line.empty() || line.comment.empty()) return;
  const std::string& c = line.comment;
  if (c.front() == '+') {
    if (!last_key_.empty()) values_[last_key_] += c.substr(1);
    return;
  }
  const std::size_t colon = c.find(": ");
  last_key_.clear();
  if (colon == std::string::npos) return;
  last_key_ = c.substr(0, colon);
  values_.emplace(last_key_, c.substr(colon + 2));
}

std::optional<std::string> ProgramHeader::value(const std::string& key) const {
  const auto it = values_.find(key);
  return it == values_.end() ? std::nullopt : std::optional<std::string>(it->second);
}

void ProgramHeader::compare(const RigDescription& rig, Mode mode, const std::string& stock_sha256,
                            Findings& findings) const {
  if (!ours()) return;
  const auto fault = [&](const std::string& sentence) {
    findings.add(Fault::kHeader, 1, 0, Vec3::Zero(), 0, [&] { return sentence; });
  };
  const auto require = [&](const char* key, const char* what, auto&& agrees) {
    const std::optional<std::string> text = value(key);
    if (!text) {
      fault(std::string("the program's header has no '") + key + "'");
    } else if (!agrees(*text)) {
      fault("the program was made for another " + std::string(what) + " (" + key + ": " + *text +
            ")");
    }
  };
  const auto point = [](const Point<MachineFrame>& p) {
    return [&p](const std::string& text) {
      const std::optional<Vec3> v = triple(text);
      return v && near(p, *v);
    };
  };
  const Kinematics& k = rig.kinematics;
  require("rig", "rig file", [&](const std::string& text) {
    return rig.sha256.empty() || text.find(rig.sha256) != std::string::npos;
  });
  require("mode", "mode", [&](const std::string& text) {
    return text == (mode == Mode::kPaper ? "paper" : "strict");
  });
  require("table", "rotary table", [&](const std::string& text) {
    char letters[3] = {};
    int tilt = 0, c = 0;
    if (std::sscanf(text.c_str(), "%2[ABC], tilt %d, c %d", letters, &tilt, &c) != 3) return false;
    return std::string(letters) == (k.table == RotaryTable::kBC ? "BC" : "AC") &&
           tilt == k.sign_tilt && c == k.sign_c;
  });
  require("pivot-r", "pivot", point(k.c_axis_point_mm));
  require("pivot-d", "pivot", point(k.tilt_offset_mm));
  require("g54", "clamping", [&](const std::string& text) {
    return point(k.g54_in_machine_mm)(text.substr(0, text.find(" (")));
  });
  require("stock", "stock", [&](const std::string& text) {
    return stock_sha256.empty() || text.find(stock_sha256) != std::string::npos;
  });
  const CutterDescription& cutter = rig.cutter;
  if (mode == Mode::kStrict) {
    require("cutter", "cutter", [&](const std::string& text) {
      double diameter = 0;
      return std::sscanf(text.c_str(), "ball D%lf", &diameter) == 1 &&
             std::fabs(diameter - cutter.diameter_mm) <= 0.0006;
    });
  }
  require("nozzle", "nozzle", [&](const std::string& text) {
    const std::size_t at = text.find("offset ");
    double diameter = 0;
    if (at == std::string::npos || std::sscanf(text.c_str(), "D%lf", &diameter) != 1) return false;
    const std::optional<Vec3> offset = triple(text.substr(at + 7));
    return offset && near(rig.nozzle.deployed_offset_mm, *offset) &&
           std::fabs(diameter - rig.nozzle.outlet_diameter_mm) <= 0.0006;
  });
}

std::optional<BlockComment> block_comment(const std::string& comment) {
  int number = 0;
  if (std::sscanf(comment.c_str(), "block %d", &number) != 1 || number < 0) return std::nullopt;
  BlockComment block{number, std::nullopt};
  const std::size_t at = comment.find("direction ");
  Vec3 d;
  if (at != std::string::npos &&
      std::sscanf(comment.c_str() + at + 10, "%lf %lf %lf", &d.x(), &d.y(), &d.z()) == 3) {
    block.direction = d;
  }
  return block;
}

}  // namespace reforge::verify
