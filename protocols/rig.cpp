#include "protocols/rig.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>

#include "protocols/sha256.h"
#include "protocols/strict_json.h"

namespace reforge {
namespace {

// Bounds that no bench-top rig exceeds: they catch a wrong unit or a lost decimal point, not taste.
constexpr double kLengthMax_mm = 2000;
constexpr double kTiny = 1e-3;
constexpr double kFeedMax_mm_per_min = 60000;
constexpr double kSecondsPerMinute = 60;

double radians(double degrees) {
  return Radians::degrees(degrees).value();
}

Point<MachineFrame> read_point(StrictObject& from, const char* key) {
  const auto xyz = from.numbers(key, 3, -kLengthMax_mm, kLengthMax_mm);
  return {xyz[0], xyz[1], xyz[2]};
}

double read_length(StrictObject& from, const char* key) {
  return from.number(key, kTiny, kLengthMax_mm);
}

double read_feed(StrictObject& from, const char* key) {
  return from.number(key, 0.1, kFeedMax_mm_per_min) / kSecondsPerMinute;
}

LinearAxis read_linear(StrictJson& document, StrictObject axes, const char* key) {
  StrictObject from = axes.object(key);
  LinearAxis axis{};
  axis.min_mm = from.number("min_mm", -kLengthMax_mm, kLengthMax_mm);
  axis.max_mm = from.number("max_mm", -kLengthMax_mm, kLengthMax_mm);
  axis.rapid_mm_per_s = read_feed(from, "rapid_mm_per_min");
  axis.max_feed_mm_per_s = read_feed(from, "max_feed_mm_per_min");
  axis.acceleration_mm_per_s2 = from.number("acceleration_mm_per_s2", 1, 20000);
  from.close();
  if (axis.min_mm >= axis.max_mm) {
    document.fail(Code::kOutOfRange, from.dotted("min_mm"), "must be less than max_mm");
  }
  return axis;
}

RotaryAxis read_rotary(StrictJson& document, StrictObject axes, const char* key) {
  StrictObject from = axes.object(key);
  RotaryAxis axis{};
  const double min_deg = from.number("min_deg", -100000, 100000);
  const double max_deg = from.number("max_deg", -100000, 100000);
  axis.min = Radians::degrees(min_deg);
  axis.max = Radians::degrees(max_deg);
  axis.rapid_rad_per_s = radians(from.number("rapid_deg_per_min", 1, 360000)) / kSecondsPerMinute;
  axis.acceleration_rad_per_s2 = radians(from.number("acceleration_deg_per_s2", 1, 36000));
  from.close();
  if (min_deg >= max_deg) {
    document.fail(Code::kOutOfRange, from.dotted("min_deg"), "must be less than max_deg");
  }
  return axis;
}

int read_sign(StrictJson& document, StrictObject& from, const char* key) {
  const int sign = from.integer(key, -1, 1);
  if (sign == 0) document.fail(Code::kOutOfRange, from.dotted(key), "must be 1 or -1");
  return sign;
}

Kinematics read_kinematics(StrictJson& document, StrictObject from) {
  Kinematics k{};
  k.table = from.one_of("table", {"BC", "AC"}) == "BC" ? RotaryTable::kBC : RotaryTable::kAC;
  k.sign_tilt = read_sign(document, from, "sign_tilt");
  k.sign_c = read_sign(document, from, "sign_c");
  k.c_axis_point_mm = read_point(from, "c_axis_point_mm");
  k.tilt_offset_mm = read_point(from, "tilt_offset_mm");
  k.g54_in_machine_mm = read_point(from, "g54_in_machine_mm");
  from.close();
  // RIG.md: D = (Dx, 0, Dz) for a BC table, (0, Dy, Dz) for an AC table.
  const bool bc = k.table == RotaryTable::kBC;
  if ((bc ? k.tilt_offset_mm.y : k.tilt_offset_mm.x) != 0) {
    document.fail(Code::kOutOfRange, from.dotted("tilt_offset_mm"),
                  bc ? "must have y = 0 on a BC table" : "must have x = 0 on an AC table");
  }
  return k;
}

// Sections stand one on the other, from the tip upwards.
std::vector<ToolSection> read_sections(StrictJson& document, StrictObject& tool, const char* key) {
  std::vector<ToolSection> sections;
  double top_mm = 0;
  for (StrictObject& from : tool.objects(key)) {
    ToolSection s{};
    s.z_from_mm = from.number("z_from_mm", 0, kLengthMax_mm);
    s.z_to_mm = from.number("z_to_mm", 0, kLengthMax_mm);
    s.r_from_mm = from.number("r_from_mm", 0, kLengthMax_mm);
    s.r_to_mm = from.number("r_to_mm", 0, kLengthMax_mm);
    from.close();
    if (s.z_to_mm <= s.z_from_mm) {
      document.fail(Code::kOutOfRange, from.dotted("z_to_mm"), "must be more than z_from_mm");
    }
    if (!sections.empty() && s.z_from_mm != top_mm) {
      document.fail(Code::kOutOfRange, from.dotted("z_from_mm"),
                    "must equal z_to_mm of the section below");
    }
    top_mm = s.z_to_mm;
    sections.push_back(s);
  }
  if (sections.empty()) {
    document.fail(Code::kMalformed, tool.dotted(key), "must have at least one section");
  }
  return sections;
}

CutterDescription read_cutter(StrictJson& document, StrictObject from) {
  CutterDescription c{};
  c.diameter_mm = from.number("diameter_mm", 0.1, 50);
  c.flute_length_mm = read_length(from, "flute_length_mm");
  c.stepdown_mm = from.number("stepdown_mm", 0.01, 50);
  c.stepover_mm = from.number("stepover_mm", 0.01, 50);
  c.feed_mm_per_s = read_feed(from, "feed_mm_per_min");
  c.ramp_feed_mm_per_s = read_feed(from, "ramp_feed_mm_per_min");
  c.spindle_rpm = from.number("spindle_rpm", 1, 100000);
  c.holder = read_sections(document, from, "holder");
  from.close();
  if (c.stepover_mm > c.diameter_mm) {
    document.fail(Code::kOutOfRange, from.dotted("stepover_mm"),
                  "must not exceed cutter.diameter_mm");
  }
  return c;
}

NozzleDescription read_nozzle(StrictJson& document, StrictObject from) {
  NozzleDescription n{};
  n.outlet_diameter_mm = from.number("outlet_diameter_mm", 0.05, 10);
  n.parked_offset_mm = read_point(from, "parked_offset_mm");
  n.deployed_offset_mm = read_point(from, "deployed_offset_mm");
  n.body = read_sections(document, from, "body");
  from.close();
  return n;
}

Extrusion read_extrusion(StrictJson& document, StrictObject from) {
  Extrusion e{};
  e.filament_diameter_mm = from.number("filament_diameter_mm", 0.5, 5);
  e.bead_width_mm = from.number("bead_width_mm", 0.05, 10);
  e.layer_height_mm = from.number("layer_height_mm", 0.02, 5);
  e.feed_mm_per_s = read_feed(from, "feed_mm_per_min");
  e.first_layer_feed_mm_per_s = read_feed(from, "first_layer_feed_mm_per_min");
  e.multiplier = from.number("multiplier", 0.1, 10);
  e.infill = from.number("infill", 0, 1);
  e.retract_mm = from.number("retract_mm", 0, 50);
  e.retract_mm_per_s = from.number("retract_mm_per_s", 0.1, 200);
  e.prime_dwell_s = from.number("prime_dwell_s", 0, 60);
  e.coast_mm = from.number("coast_mm", 0, 50);
  e.travel_without_retract_mm = from.number("travel_without_retract_mm", 0, 100);
  e.steps_per_mm = from.number("steps_per_mm", 1, 100000);
  const double target_c = from.number("nozzle_temperature_c", 0, 500);
  const double minimum_c = from.number("minimum_temperature_c", 0, 500);
  const double maximum_c = from.number("maximum_temperature_c", 0, 500);
  from.close();
  if (!(minimum_c <= target_c && target_c < maximum_c)) {
    document.fail(Code::kOutOfRange, from.dotted("nozzle_temperature_c"),
                  "must lie between minimum_temperature_c and maximum_temperature_c");
  }
  e.nozzle_temperature = Celsius::of(target_c);
  e.minimum_temperature = Celsius::of(minimum_c);
  e.maximum_temperature = Celsius::of(maximum_c);
  return e;
}

CncLink read_cnc(StrictObject from) {
  CncLink link{};
  const std::string dialect = from.one_of("dialect", {"grbl", "marlin", "fanuc"});
  link.dialect = dialect == "grbl"     ? CncDialect::kGrbl
                 : dialect == "marlin" ? CncDialect::kMarlin
                                       : CncDialect::kFanuc;
  link.baud = from.integer("baud", 1200, 4000000);
  link.receive_buffer_bytes = from.integer("receive_buffer_bytes", 16, 1 << 20);
  link.line_length_max = from.integer("line_length_max", 20, 1024);
  link.m_codes = from.one_of("m_codes", {"relay", "in-stream"}) == "relay" ? MCodeRoute::kRelay
                                                                           : MCodeRoute::kInStream;
  from.close();
  return link;
}

void read_commissioning(StrictObject& root, RigDescription& rig) {
  std::optional<StrictObject> from = root.object_or_null("commissioned");
  if (!from) return;
  rig.commissioned = Commissioning{from->text("by"), from->text("date"), from->text("note")};
  from->close();
}

void read_assumed(StrictJson& document, StrictObject& root, RigDescription& rig) {
  rig.assumed = root.texts("assumed");
  for (const std::string& key : rig.assumed) {
    if (!document.has(key)) {
      document.fail(Code::kUnknownKey, "assumed",
                    "names " + key + ", which is no key of this file");
    }
  }
}

}  // namespace

Result<RigDescription> parse_rig(std::string_view text, const std::string& name_for_errors) {
  StrictJson document(text, name_for_errors);
  if (document.error()) return *document.error();
  StrictObject root = document.root();
  RigDescription rig{};
  if (root.text("format") != "reforge-rig 1") {
    document.fail(Code::kWrongVersion, "format", "must be \"reforge-rig 1\"");
  }
  rig.name = root.text("name");
  rig.sha256 = sha256_hex(text);
  read_commissioning(root, rig);
  read_assumed(document, root, rig);
  const auto space = root.numbers("working_space_mm", 3, 1, kLengthMax_mm);
  rig.working_space_mm = {space[0], space[1], space[2]};
  rig.clear_height_mm = root.number("clear_height_mm", 0, kLengthMax_mm);

  StrictObject axes = root.object("axes");
  rig.x = read_linear(document, axes, "x");
  rig.y = read_linear(document, axes, "y");
  rig.z = read_linear(document, axes, "z");
  rig.tilt = read_rotary(document, axes, "tilt");
  rig.c = read_rotary(document, axes, "c");

  rig.kinematics = read_kinematics(document, root.object("kinematics"));
  StrictObject spindle = root.object("spindle");
  rig.spindle = {spindle.number("min_rpm", 0, 100000), spindle.number("max_rpm", 1, 100000),
                 spindle.number("spin_up_s", 0, 120)};
  spindle.close();
  StrictObject table = root.object("table");
  rig.table = {read_length(table, "disc_radius_mm"), read_length(table, "disc_thickness_mm")};
  table.close();
  StrictObject pedestal = root.object("pedestal");
  rig.pedestal = {pedestal.number("height_mm", 0, kLengthMax_mm),
                  pedestal.number("inset_mm", 0, kLengthMax_mm),
                  pedestal.number("minimum_width_mm", 0, kLengthMax_mm)};
  pedestal.close();

  rig.cutter = read_cutter(document, root.object("cutter"));
  rig.nozzle = read_nozzle(document, root.object("nozzle"));
  StrictObject finishing = root.object("finishing");
  rig.roughing_allowance_mm = finishing.number("roughing_allowance_mm", 0, 10);
  rig.scallop_mm = finishing.number("scallop_mm", 0.001, 1);
  finishing.close();
  rig.extrusion = read_extrusion(document, root.object("extrusion"));
  rig.cnc = read_cnc(root.object("cnc"));
  root.close();

  if (!(rig.spindle.min_rpm <= rig.cutter.spindle_rpm &&
        rig.cutter.spindle_rpm <= rig.spindle.max_rpm)) {
    document.fail(Code::kOutOfRange, "cutter.spindle_rpm",
                  "must lie between spindle.min_rpm and spindle.max_rpm");
  }
  if (document.error()) return *document.error();
  return rig;
}

Result<RigDescription> read_rig(const std::filesystem::path& file) {
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  if (in) text << in.rdbuf();
  if (!in || in.bad()) {
    return Result<RigDescription>::fail(
        Code::kUnreadable, "The rig file " + file.string() + " cannot be read: " +
                               (errno ? std::strerror(errno) : "it is empty or no file"));
  }
  return parse_rig(text.str(), file.string());
}

// RIG.md counts the cutter's solid from the ball's centre c, 1.5 mm above the tip; here all heights
// count from the tip. Below 3.0 mm (c + 1.5) nothing counts.
CutterDescription paper_cutter(const CutterDescription& rigs) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  CutterDescription cutter = rigs;
  cutter.diameter_mm = 3;
  cutter.flute_length_mm = 16;
  cutter.holder = {{3, 16, 1.5, 1.5}, {16, 46, 25, 25}, {46, kInf, kInf, kInf}};
  return cutter;
}

NozzleDescription paper_nozzle(const NozzleDescription& rigs) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  NozzleDescription nozzle = rigs;
  nozzle.body = {{0.2, 5.2, 2, 2}, {5.2, 10.2, 4.5, 4.5}, {10.2, kInf, kInf, kInf}};
  return nozzle;
}

}  // namespace reforge
