#include "tools/reforge/bead_trace.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "protocols/gcode/modal.h"

namespace reforge {
namespace {

using nlohmann::json;
using Place = std::array<double, 3>;

double distance(const Place& a, const Place& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

struct ProgramBead {
  std::size_t line;
  double rate_mm_per_s;
  double dwell_s = 0;  // before the first move
  std::vector<Place> path;
  std::vector<double> seconds;  // to each point of the path, from the first move on
  double length = 0;
};

std::optional<Place> place_of(const gcode::ModalState& state) {
  Place p{};
  for (std::size_t k = 0; k < 3; ++k) {
    if (!state.position[k]) return std::nullopt;
    p[k] = *state.position[k];
  }
  return p;
}

double default_rate(const Extrusion& e) {
  const double section = std::numbers::pi * e.filament_diameter_mm * e.filament_diameter_mm / 4;
  return e.feed_mm_per_s * e.bead_width_mm * e.layer_height_mm / section * e.multiplier;
}

Result<std::vector<ProgramBead>> beads_of(const std::filesystem::path& file,
                                          const RigDescription& rig) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return Error{Code::kUnreadable, "cannot open the program " + file.string()};
  gcode::LineReader reader(in, gcode::dialect_of(rig.cnc, rig.kinematics.table));
  gcode::Line line;
  gcode::ModalState state;
  std::vector<ProgramBead> beads;
  for (;;) {
    const Result<bool> read = reader.next(line);
    if (!read) return Error{read.error().code, file.string() + ": " + read.error().sentence};
    if (!*read) return beads;
    const bool was_on = state.extruding;
    const Result<gcode::Action> action = gcode::apply(line, reader.dialect(), state);
    if (!action) return Error{action.error().code, file.string() + ": " + action.error().sentence};
    if (state.extruding && !was_on) {
      const std::optional<Place> at = place_of(state);
      if (!at) {
        return Error{Code::kMalformed, file.string() + ": line " + std::to_string(line.number) +
                                           ": M72 before X, Y and Z were said"};
      }
      beads.push_back({line.number,
                       state.filament_mm_per_s.value_or(default_rate(rig.extrusion)),
                       0,
                       {*at},
                       {0},
                       0});
    }
    if (!was_on || !state.extruding) continue;
    ProgramBead& bead = beads.back();
    if (action->kind == gcode::Action::Kind::kDwell && bead.path.size() == 1) {
      bead.dwell_s += action->dwell_s;
    }
    if (action->kind == gcode::Action::Kind::kMove && state.feed_mm_per_min) {
      const Place to = *place_of(state);
      const double way = distance(bead.path.back(), to);
      bead.length += way;
      bead.seconds.push_back(bead.seconds.back() + way / (*state.feed_mm_per_min / 60));
      bead.path.push_back(to);
    }
  }
}

struct Record {
  double t;
  std::string event;
  Place at{};
  double steps = 0;
  int moving = 0;
};

// The records that speak of filament, in order of time.
Result<std::vector<Record>> filament_records(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) return Error{Code::kUnreadable, "cannot open the trace " + file.string()};
  std::vector<Record> records;
  std::string text;
  for (int line = 1; std::getline(in, text); ++line) {
    try {
      const json record = json::parse(text);
      const std::string event = record.at("ev");
      if (event != "steps" && event != "flow" && event != "extrude_on" && event != "extrude_off") {
        continue;
      }
      records.push_back({record.at("t"),
                         event,
                         {record.at("x"), record.at("y"), record.at("z")},
                         record.at("steps"),
                         record.value("moving", 0)});
    } catch (const json::exception& e) {
      return Error{Code::kMalformed, file.string() + ":" + std::to_string(line) +
                                         ": expected a record of the rig's trace: " + e.what()};
    }
  }
  std::stable_sort(records.begin(), records.end(),
                   [](const Record& a, const Record& b) { return a.t < b.t; });
  return records;
}

// Where on the bead the nozzle should be `seconds` after the first move, and where it is nearest.
double along_at_time(const ProgramBead& bead, double seconds) {
  double along = 0;
  for (std::size_t k = 1; k < bead.path.size(); ++k) {
    const double way = distance(bead.path[k - 1], bead.path[k]);
    const double took = bead.seconds[k] - bead.seconds[k - 1];
    if (seconds < bead.seconds[k]) {
      const double share = took > 0 ? (seconds - bead.seconds[k - 1]) / took : 0.0;
      return along + std::max(0.0, share) * way;
    }
    along += way;
  }
  return along;
}

// The place's own distance along the bead; of several near ones, that nearest to `wanted`.
double along_at_place(const ProgramBead& bead, const Place& p, double wanted) {
  double best = 0, best_score = std::numeric_limits<double>::infinity(), along = 0;
  for (std::size_t k = 1; k < bead.path.size(); ++k) {
    const Place &a = bead.path[k - 1], &b = bead.path[k];
    const double way = distance(a, b);
    double dot = 0;
    for (std::size_t c = 0; c < 3; ++c) dot += (p[c] - a[c]) * (b[c] - a[c]);
    const double share = way > 0 ? std::clamp(dot / (way * way), 0.0, 1.0) : 0.0;
    Place q{};
    for (std::size_t c = 0; c < 3; ++c) q[c] = a[c] + share * (b[c] - a[c]);
    const double here = along + share * way;
    // Off the path counts a hundredfold: on it to a few micrometres, the nearest pass is meant.
    const double score = 100 * distance(p, q) + std::fabs(here - wanted);
    if (score < best_score) best_score = score, best = here;
    along += way;
  }
  return best;
}

BeadComparison compare(const ProgramBead& bead, const Record* begin, const Record* end,
                       const RigDescription& rig, bool& flow_recorded) {
  const double per_mm = rig.extrusion.steps_per_mm;
  BeadComparison c;
  c.line = bead.line;
  c.length_mm = bead.length;
  c.planned_mm = bead.rate_mm_per_s * (bead.dwell_s + bead.seconds.back());
  c.counted_mm = (end->steps - begin->steps) / per_mm;
  Place first = begin->at, last = end->at;
  for (const Record* r = begin + 1; r != end; ++r) {
    if (r->event == "steps" && r->moving > 0 && r->steps <= begin->steps) first = r->at;
    if (r->event == "steps") last = r->moving == 0 ? r->at : end->at;
    if (r->event != "flow") continue;
    flow_recorded = true;
    const double fed = (r->steps - begin->steps) / per_mm;
    const double wanted = along_at_time(bead, fed / bead.rate_mm_per_s - bead.dwell_s);
    c.lag_mm = std::max(c.lag_mm, std::fabs(along_at_place(bead, r->at, wanted) - wanted));
  }
  if (c.counted_mm <= 0) {
    // Nothing came out: the whole bead is missing.
    c.start_error_mm = c.end_error_mm = std::max(bead.length, 1.0);
    return c;
  }
  c.start_error_mm = distance(first, bead.path.front());
  c.end_error_mm = distance(last, bead.path.back());
  return c;
}

}  // namespace

const BeadComparison* TraceComparison::worst_start() const {
  const auto it = std::max_element(beads.begin(), beads.end(), [](const auto& a, const auto& b) {
    return a.start_error_mm < b.start_error_mm;
  });
  return it == beads.end() ? nullptr : &*it;
}

const BeadComparison* TraceComparison::worst_end() const {
  const auto it = std::max_element(beads.begin(), beads.end(), [](const auto& a, const auto& b) {
    return a.end_error_mm < b.end_error_mm;
  });
  return it == beads.end() ? nullptr : &*it;
}

bool TraceComparison::good(double tolerance_mm) const {
  return program_beads == trace_beads &&
         std::all_of(beads.begin(), beads.end(), [&](const BeadComparison& b) {
           return b.start_error_mm <= tolerance_mm && b.end_error_mm <= tolerance_mm;
         });
}

Result<TraceComparison> compare_trace(const std::filesystem::path& program,
                                      const RigDescription& rig,
                                      const std::filesystem::path& trace) {
  const Result<std::vector<ProgramBead>> beads = beads_of(program, rig);
  if (!beads) return beads.error();
  const Result<std::vector<Record>> read = filament_records(trace);
  if (!read) return read.error();
  const std::vector<Record>& records = *read;
  TraceComparison result;
  result.program_beads = beads->size();
  for (std::size_t k = 0; k < records.size(); ++k) {
    if (records[k].event != "extrude_on") continue;
    std::size_t end = k + 1;
    while (end < records.size() && records[end].event != "extrude_off") ++end;
    if (end == records.size()) {
      return Error{Code::kMalformed,
                   trace.string() + ": the trace ends while filament is extruded"};
    }
    if (result.trace_beads < beads->size()) {
      result.beads.push_back(compare((*beads)[result.trace_beads], &records[k], &records[end], rig,
                                     result.flow_recorded));
    }
    ++result.trace_beads;
    k = end;
  }
  return result;
}

}  // namespace reforge
