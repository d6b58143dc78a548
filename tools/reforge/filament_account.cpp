#include "tools/reforge/filament_account.h"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace reforge {
namespace {

struct OpenBead {
  double since_s;
  double rate_mm_per_s;
  double steps;
};

// Applies one record; returns a sentence when the trace contradicts itself.
std::optional<std::string> take(const nlohmann::json& record, FilamentAccount& account,
                                std::optional<OpenBead>& bead, bool& retracted, double steps_per_mm,
                                double retract_mm) {
  const std::string event = record.at("ev");
  const double t = record.at("t");
  account.seconds = std::max(account.seconds, t);
  if (event == "extrude_on") {
    if (bead) return "extrusion begins twice";
    if (!record.contains("filament_mm_per_s"))
      return "the order that began extrusion names no speed";
    bead = OpenBead{t, record.at("filament_mm_per_s"), record.at("steps")};
    if (retracted) account.retract_ordered_mm -= retract_mm;
    retracted = false;
  } else if (event == "extrude_off") {
    if (!bead) return std::nullopt;  // M73 where nothing was extruded: the safe order, twice
    account.beads += 1;
    account.ordered_mm += bead->rate_mm_per_s * (t - bead->since_s);
    account.extruded_mm += (record.at("steps").get<double>() - bead->steps) / steps_per_mm;
    bead.reset();
  } else if (event == "retract" && record.at("on").get<bool>()) {
    account.retractions += 1;
    account.retract_ordered_mm += retract_mm;
    retracted = true;
  }
  if (record.contains("steps")) account.net_mm = record.at("steps").get<double>() / steps_per_mm;
  return std::nullopt;
}

}  // namespace

double FilamentAccount::error() const {
  const double ordered = ordered_mm - retract_ordered_mm;
  if (ordered == 0) return std::abs(net_mm) > 0 ? 1 : 0;
  return (net_mm - ordered) / ordered;
}

Result<FilamentAccount> read_filament_account(const std::filesystem::path& trace,
                                              double steps_per_mm, double retract_mm) {
  std::ifstream in(trace);
  if (!in) {
    return Error{Code::kUnreadable, "cannot open the trace " + trace.string()};
  }
  FilamentAccount account;
  std::optional<OpenBead> bead;
  bool retracted = false;
  std::string text;
  for (int line = 1; std::getline(in, text); ++line) {
    const auto fault = [&](const std::string& what) {
      return Error{Code::kMalformed, trace.string() + ":" + std::to_string(line) + ": " + what};
    };
    try {
      const auto wrong =
          take(nlohmann::json::parse(text), account, bead, retracted, steps_per_mm, retract_mm);
      if (wrong) return fault(*wrong);
    } catch (const nlohmann::json::exception& e) {
      return fault(std::string("expected a record of the rig's trace: ") + e.what());
    }
  }
  if (bead) {
    return Error{Code::kMalformed, trace.string() + ": the trace ends while filament is extruded"};
  }
  return account;
}

}  // namespace reforge
