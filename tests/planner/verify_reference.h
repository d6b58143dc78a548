// A slow judge of programs, for the verifier's tests: it decides whether a fault changes the
// outcome.
//
// Shares nothing with the verifier but the rig file's data: a reader of its own for the words our
// programs use (anything else counts as a broken rule), kinematics written out from RIG.md, and
// material as one bit per 0.05 mm cube, cut and filled by testing cubes one by one. Rules are those
// of the verifier's issue: states, limits and feeds, a body or the cutter more than 0.1 mm in what
// it must not touch. Bodies are shrunk by 0.1 mm so that what remains to be met is at fault.
// Part frame, mm. Limits: rotary moves are judged by their clear height alone; strict mode only.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "planner/verify/verify.h"

namespace reforge::mutation {

// Bits of cubes, x fastest, each row padded to whole words.
struct Cubes {
  static constexpr double kSize = 0.05;
  Vec3 origin = Vec3::Zero();
  std::array<int, 3> n{};
  std::size_t row_words = 0;
  std::vector<std::uint64_t> bits;

  Cubes() = default;
  Cubes(const Vec3& lowest, const Vec3& highest) : origin(lowest) {
    for (int k = 0; k < 3; ++k) {
      n[static_cast<std::size_t>(k)] =
          static_cast<int>(std::ceil((highest[k] - lowest[k]) / kSize));
    }
    row_words = static_cast<std::size_t>((n[0] + 63) / 64);
    bits.assign(row_words * static_cast<std::size_t>(n[1]) * static_cast<std::size_t>(n[2]), 0);
  }
  std::size_t row(int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(n[1]) +
            static_cast<std::size_t>(j)) *
           row_words;
  }
  Vec3 centre(int i, int j, int k) const {
    return origin + kSize * Vec3(i + 0.5, j + 0.5, k + 0.5);
  }
  bool at(int i, int j, int k) const {
    if (i < 0 || j < 0 || k < 0 || i >= n[0] || j >= n[1] || k >= n[2]) return false;
    return (bits[row(j, k) + static_cast<std::size_t>(i / 64)] >> (i % 64)) & 1;
  }
  void set(int i, int j, int k, bool on) {
    std::uint64_t& word = bits[row(j, k) + static_cast<std::size_t>(i / 64)];
    const std::uint64_t bit = std::uint64_t{1} << (i % 64);
    word = on ? word | bit : word & ~bit;
  }
  // Calls visit(i, j, k) for each set cube (or each cube, if `all`) within the box.
  template <typename Visit>
  void each(const Box3& box, bool all, const Visit& visit) const {
    std::array<int, 3> lo{}, hi{};
    for (int k = 0; k < 3; ++k) {
      const auto a = static_cast<std::size_t>(k);
      lo[a] = std::max(0, static_cast<int>(std::floor((box.min()[k] - origin[k]) / kSize)));
      hi[a] = std::min(n[a], static_cast<int>(std::ceil((box.max()[k] - origin[k]) / kSize)));
    }
    for (int k = lo[2]; k < hi[2]; ++k) {
      for (int j = lo[1]; j < hi[1]; ++j) {
        for (int i = lo[0]; i < hi[0];) {
          const std::uint64_t rest =
              all ? 1 : bits[row(j, k) + static_cast<std::size_t>(i / 64)] >> (i % 64);
          if (rest == 0) {
            i = (i / 64 + 1) * 64;
            continue;
          }
          if (rest & 1) visit(i, j, k);
          ++i;
        }
      }
    }
  }
  // Whether test(centre) holds for any set cube within the box that reaches `lowest` along `up`.
  template <typename Test>
  bool any(const Box3& box, const Vec3& up, double lowest, const Test& test) const {
    bool met = false;
    // Row by row: where the whole row is too low, or an answer is known, nothing is looked at.
    Box3 row = box;
    const int k0 = std::max(0, static_cast<int>((box.min().z() - origin.z()) / kSize));
    const int k1 = std::min(n[2], static_cast<int>((box.max().z() - origin.z()) / kSize) + 1);
    const int j0 = std::max(0, static_cast<int>((box.min().y() - origin.y()) / kSize));
    const int j1 = std::min(n[1], static_cast<int>((box.max().y() - origin.y()) / kSize) + 1);
    const double x0 = std::max(box.min().x(), origin.x());
    const double x1 = std::min(box.max().x(), origin.x() + kSize * n[0]);
    for (int k = k0; k < k1 && !met; ++k) {
      for (int j = j0; j < j1 && !met; ++j) {
        const Vec3 middle = centre(0, j, k);
        if (up.y() * middle.y() + up.z() * middle.z() + std::max(up.x() * x0, up.x() * x1) <
            lowest) {
          continue;
        }
        row.min().y() = row.max().y() = middle.y();
        row.min().z() = row.max().z() = middle.z();
        each(row, false, [&](int a, int b, int c) { met = met || test(centre(a, b, c)); });
      }
    }
    return met;
  }
  void fill(const TriangleMesh& mesh) {
    for (int j = 0; j < n[1]; ++j) {
      for (int i = 0; i < n[0]; ++i) {
        // A line along z, a little off the round numbers that edges like to lie on.
        const double x = origin.x() + kSize * (i + 0.5) + 1.7e-5;
        const double y = origin.y() + kSize * (j + 0.5) + 2.3e-5;
        std::vector<std::pair<double, int>> hits;
        for (const auto& t : mesh.triangles) {
          const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
          const double area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
          if (std::fabs(area) < 1e-12) continue;
          const double u = ((x - a.x()) * (c.y() - a.y()) - (y - a.y()) * (c.x() - a.x())) / area;
          const double v = ((b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x())) / area;
          if (u < 0 || v < 0 || u + v > 1) continue;
          hits.push_back({a.z() + u * (b.z() - a.z()) + v * (c.z() - a.z()), area < 0 ? 1 : -1});
        }
        std::sort(hits.begin(), hits.end());
        int inside = 0;
        std::size_t next = 0;
        for (int k = 0; k < n[2]; ++k) {
          const double z = origin.z() + kSize * (k + 0.5);
          while (next < hits.size() && hits[next].first <= z) inside += hits[next++].second;
          if (inside > 0) set(i, j, k, true);
        }
      }
    }
  }
};

struct ReferenceOutcome {
  std::string broken;                         // the first rule that was broken; empty: none
  std::vector<std::array<double, 11>> moves;  // what the tools did, as far as it leaves traces
  Cubes part;
};

class Reference {
 public:
  Reference(const VerifyInputs& inputs, const Box3& room) : in_(inputs), rig_(inputs.rig) {
    out_.part = kept_ = Cubes(room.min(), room.max());
    outline_ = inputs.initial.vertices;
    outline_.insert(outline_.end(), inputs.target->vertices.begin(), inputs.target->vertices.end());
    for (const Vec3& p : outline_) room_.extend(p);
    room_ = Box3(room_.min() - Vec3::Constant(0.5), room_.max() + Vec3::Constant(0.5));
    outline_.insert(outline_.end(), inputs.fixture->vertices.begin(),
                    inputs.fixture->vertices.end());
    sample_fixture();
  }

  // With the outcome of a good program from the same inputs, cubes are cut only if the tools move
  // another way.
  ReferenceOutcome run(const std::string& program, const ReferenceOutcome* good = nullptr) {
    if (good) {
      Reference rules(*this);
      rules.rules_only_ = true;
      ReferenceOutcome outcome = rules.obey_all(program);
      if (!outcome.broken.empty()) return outcome;
      if (outcome.moves == good->moves) return *good;
    }
    out_.part.fill(in_.initial);
    kept_.fill(*in_.reused);
    return obey_all(program);
  }

 private:
  ReferenceOutcome obey_all(const std::string& program) {
    std::istringstream in(program);
    std::string text;
    for (line_ = 1; std::getline(in, text) && out_.broken.empty(); ++line_) {
      if (text.size() > static_cast<std::size_t>(rig_.cnc.line_length_max)) broken("long line");
      obey(text.substr(0, text.find(';')));
    }
    if (out_.broken.empty()) {
      if (!ended_) broken("no end");
      if (open_ || extruding_ || spindle_) broken("ends with something on");
    }
    return std::move(out_);
  }

  using Words = std::map<char, double>;

  void broken(const std::string& what) {
    if (out_.broken.empty()) out_.broken = what + " (line " + std::to_string(line_) + ")";
  }

  // ---- words -------------------------------------------------------------------------------
  void obey(const std::string& text) {
    Words w;
    std::vector<int> g, m;
    const char* p = text.c_str();
    while (*p) {
      if (*p == ' ' || *p == '\t' || *p == '\r') {
        ++p;
        continue;
      }
      const char letter = *p >= 'a' && *p <= 'z' ? static_cast<char>(*p - 'a' + 'A') : *p;
      ++p;
      const bool number = (*p >= '0' && *p <= '9') || *p == '-' || *p == '.' || *p == '+';
      if (letter < 'A' || letter > 'Z' || !number) return broken("not a word");
      char* end = nullptr;
      const double value = std::strtod(p, &end);
      if (std::string(p, static_cast<const char*>(end)).find_first_not_of("+-.0123456789") !=
          std::string::npos) {
        return broken("not a number");
      }
      p = end;
      if (letter == 'G' || letter == 'M') {
        (letter == 'G' ? g : m).push_back(static_cast<int>(std::lround(value * 10)));
      } else if (!w.emplace(letter, value).second) {
        return broken("a word twice");
      }
    }
    if (g.empty() && m.empty() && w.empty()) return;
    if (ended_) return broken("goes on after its end");
    const char tilt = rig_.kinematics.table == RotaryTable::kBC ? 'B' : 'A';
    for (const auto& [letter, value] : w) {
      if (std::string("XYZCFSP").find(letter) == std::string::npos && letter != tilt) {
        return broken("unknown word");
      }
    }
    bool dwell = false;
    for (const int code : g) {
      switch (code) {
        case 0:
        case 10:
          rapid_ = code == 0;
          moded_ = true;
          break;
        case 40:
          dwell = true;
          break;
        case 200:
        case 210:
          inch_ = code == 200 ? 25.4 : 1;
          unit_said_ = true;
          break;
        case 900:
        case 910:
          relative_ = code == 910;
          distance_said_ = true;
          break;
        case 940:
        case 170:
        case 540:
          break;
        default:
          return broken("unknown G");
      }
    }
    if (g.size() > 1) {
      // Two codes of one group, or a dwell beside others: nothing our programs say.
      return broken("two G codes");
    }
    if (m.size() > 1) return broken("two M codes");
    if (dwell) {
      if (w.size() != 1 || !w.count('P') || w['P'] < 0 || !m.empty()) return broken("dwell");
      spun_s_ += w['P'];
      return;
    }
    if (w.count('F')) {
      if (!(w['F'] > 0) || !unit_said_) return broken("feed");
      feed_ = w['F'] * inch_ / 60;
    }
    if (w.count('S') && (m.empty() || m[0] != 700)) {
      if (w['S'] < 0) return broken("speed");
      speed_ = w['S'];
      if (spindle_) check_speed();
    }
    if (!m.empty()) {
      if (m[0] >= 700 && m[0] <= 750 && m[0] % 10 == 0) {
        if (!g.empty()) return broken("M with G");
        return extruder(m[0] / 10, w);
      }
      switch (m[0]) {
        case 30:
          spindle_ = true;
          spun_s_ = 0;
          if (open_) broken("spindle with the module open");
          check_speed();
          break;
        case 50:
          spindle_ = false;
          break;
        case 20:
        case 300:
          if (!w.empty() || !g.empty()) broken("end not alone");
          ended_ = true;
          return;
        default:
          return broken("unknown M");
      }
    }
    if (w.count('P')) return broken("P");
    move(w, tilt);
  }

  void check_speed() {
    if (speed_ < rig_.spindle.min_rpm || speed_ > rig_.spindle.max_rpm) broken("spindle speed");
  }

  void extruder(int code, const Words& w) {
    const auto argument = [&](char letter) -> std::optional<double> {
      const auto it = w.find(letter);
      if (it == w.end()) return std::nullopt;
      if (!(it->second > 0)) broken("argument");
      return it->second;
    };
    const std::size_t takes = code == 70 || code == 72 || code == 74 ? 1 : 0;
    if (w.size() > takes || (w.size() == 1 && !w.count(code == 70 ? 'S' : 'P'))) {
      return broken("words beside an extruder code");
    }
    switch (code) {
      case 70: {
        const std::optional<double> celsius = argument('S');
        if (celsius && (*celsius < rig_.extrusion.minimum_temperature.value() ||
                        *celsius > rig_.extrusion.maximum_temperature.value())) {
          broken("temperature");
        }
        if (extruding_ || spindle_) broken("M70 with something on");
        open_ = true;
        check_height("M70 low");
        break;
      }
      case 71:
        if (extruding_ || retracting_) broken("M71 with something on");
        if (open_) check_height("M71 low");
        open_ = mouth_ = false;
        break;
      case 72:
        if (!open_ || retracting_ || extruding_) broken("M72 out of order");
        extruding_ = mouth_ = true;
        rate_ = argument('P').value_or(filament(rig_.extrusion.feed_mm_per_s));
        dry_ = travel_ = 0;
        break;
      case 73:
        if (!extruding_) broken("M73 out of order");
        extruding_ = false;
        dry_ = travel_ = 0;
        break;
      case 74:
        (void)argument('P');
        if (!open_ || extruding_ || retracting_ || !mouth_) broken("M74 out of order");
        retracting_ = true;
        mouth_ = false;
        break;
      default:
        if (!retracting_) broken("M75 out of order");
        retracting_ = false;
        break;
    }
  }

  double section() const {
    return std::numbers::pi * std::pow(rig_.extrusion.filament_diameter_mm / 2, 2);
  }
  double filament(double feed) const {
    return feed * rig_.extrusion.bead_width_mm * rig_.extrusion.layer_height_mm / section() *
           rig_.extrusion.multiplier;
  }

  // ---- kinematics, from RIG.md --------------------------------------------------------------
  Vec3 to_part(const Vec3& j) const { return part_turn(j - pivot()) + pivot_out(); }
  Vec3 r() const {
    const auto& p = rig_.kinematics.c_axis_point_mm;
    return {p.x, p.y, p.z};
  }
  Vec3 d() const {
    const auto& p = rig_.kinematics.tilt_offset_mm;
    return {p.x, p.y, p.z};
  }
  Vec3 pivot() const { return r() + d(); }
  Vec3 pivot_out() const { return r() + about_z(d()); }
  Vec3 about_z(const Vec3& v) const {
    const double g = rig_.kinematics.sign_c * c_ * std::numbers::pi / 180;
    return {std::cos(g) * v.x() - std::sin(g) * v.y(), std::sin(g) * v.x() + std::cos(g) * v.y(),
            v.z()};
  }
  Vec3 part_turn(const Vec3& v) const {
    const double t = rig_.kinematics.sign_tilt * tilt_ * std::numbers::pi / 180;
    const double c = std::cos(t), s = std::sin(t);
    if (rig_.kinematics.table == RotaryTable::kBC) {
      return about_z({c * v.x() + s * v.z(), v.y(), -s * v.x() + c * v.z()});
    }
    return about_z({v.x(), c * v.y() - s * v.z(), s * v.y() + c * v.z()});
  }
  double machine_top() const {
    const Vec3 n = part_turn(Vec3::UnitZ());
    double top = -std::numeric_limits<double>::infinity();
    for (const Vec3& p : outline_) top = std::max(top, n.dot(p - pivot_out()) + pivot().z());
    return top;
  }
  void check_height(const char* what) {
    const double low = open_ ? std::min(0.0, rig_.nozzle.deployed_offset_mm.z)
                             : std::min(0.0, rig_.nozzle.parked_offset_mm.z);
    if (!at_[2] || *at_[2] + low < machine_top() + rig_.clear_height_mm - 1.0) broken(what);
  }

  // ---- motion ------------------------------------------------------------------------------
  void move(const Words& w, char tilt) {
    std::array<std::optional<double>, 3> to = at_;
    bool shifts = false;
    const bool turns = w.count(tilt) || w.count('C');
    for (int k = 0; k < 3; ++k) {
      const auto it = w.find("XYZ"[k]);
      if (it == w.end()) continue;
      std::optional<double>& x = to[static_cast<std::size_t>(k)];
      if (relative_ && !x) return broken("relative from nowhere");
      x = it->second * inch_ + (relative_ ? *x : 0.0);
      shifts = true;
    }
    if (!shifts && !turns) return;
    if (!moded_ || !unit_said_ || !distance_said_) return broken("motion without modes");
    if (!rapid_ && feed_ <= 0) return broken("no feed");
    limits(to);
    if (turns) {
      if (shifts || !rapid_) return broken("rotary not alone");
      if (extruding_ || mouth_) return broken("rotary while filament is out");
      const auto said = [&](char letter, double now) {
        const auto it = w.find(letter);
        if (it == w.end()) return now;
        return it->second + (relative_ ? now : 0.0);
      };
      const double tilt1 = said(tilt, tilt_), c1 = said('C', c_);
      const double tilt0 = tilt_, c0 = c_;
      for (int k = 0; k <= 36; ++k) {
        tilt_ = tilt0 + (tilt1 - tilt0) * k / 36;
        c_ = c0 + (c1 - c0) * k / 36;
        check_height("rotary low");
      }
      if (tilt_ < rig_.tilt.min.in_degrees() || tilt_ > rig_.tilt.max.in_degrees() ||
          c_ < rig_.c.min.in_degrees() || c_ > rig_.c.max.in_degrees()) {
        broken("rotary limit");
      }
      return;
    }
    const bool known = at_[0] && at_[1] && at_[2];
    const Vec3 a = known ? Vec3(*at_[0], *at_[1], *at_[2]) : Vec3(Vec3::Zero());
    at_ = to;
    if (!known) {
      const double z = to[2].value_or(-1e9);
      if (z < machine_top()) broken("near the part from nowhere");
      return;
    }
    const Vec3 b(*to[0], *to[1], *to[2]);
    if ((b - a).norm() <= 0) return;
    if (!rapid_) check_feed(b - a);
    record(to_part(a), to_part(b));
    open_ ? print(a, b) : mill(a, b);
    spun_s_ += (b - a).norm() / (rapid_ ? rig_.z.rapid_mm_per_s : feed_);
  }

  void record(const Vec3& a, const Vec3& b) {
    const Vec3 n = part_turn(Vec3::UnitZ());
    const bool turning = spindle_ && spun_s_ >= rig_.spindle.spin_up_s - 0.02;
    const double flow = extruding_ ? rate_ / feed_ : 0.0;
    out_.moves.push_back({a.x(), a.y(), a.z(), b.x(), b.y(), b.z(), n.x(), n.y(), flow,
                          open_ ? 1.0 : 0.0,
                          rapid_    ? 2.0
                          : turning ? 1.0
                                    : 0.0});
  }

  void limits(const std::array<std::optional<double>, 3>& to) {
    const auto& g = rig_.kinematics.g54_in_machine_mm;
    const std::array<double, 3> shift{g.x, g.y, g.z};
    const std::array<const LinearAxis*, 3> axes{&rig_.x, &rig_.y, &rig_.z};
    for (std::size_t k = 0; k < 3; ++k) {
      if (!to[k]) continue;
      const double x = *to[k] + shift[k];
      if (x < axes[k]->min_mm - 0.01 || x > axes[k]->max_mm + 0.01) broken("axis limit");
    }
  }

  void check_feed(const Vec3& d) {
    const std::array<double, 3> most{rig_.x.max_feed_mm_per_s, rig_.y.max_feed_mm_per_s,
                                     rig_.z.max_feed_mm_per_s};
    for (int k = 0; k < 3; ++k) {
      const double share = (std::fabs(d[k]) - 0.001) / d.norm();
      if (share > 0 && feed_ * share > most[static_cast<std::size_t>(k)] * 1.01) broken("feed");
    }
    if (!open_ && feed_ > rig_.cutter.feed_mm_per_s * 1.01) broken("cutter's feed");
    if (feed_ < 0.099) broken("hardly moving");
  }

  // A tool's region: radius by height over its tip, swept from a to b (tips, part frame).
  struct Sweep {
    Vec3 a, b, n;  // n: towards the spindle
    double level;  // rise along n
    Vec3 across;   // b - a without its rise
    double square;
  };
  Sweep sweep(const Vec3& a, const Vec3& b) const {
    Sweep s{a, b, part_turn(Vec3::UnitZ()), 0, {}, 0};
    s.level = s.n.dot(b - a);
    s.across = (b - a) - s.level * s.n;
    s.square = s.across.squaredNorm();
    return s;
  }
  // Smallest over the sweep of profile(distance) + height of the tip, and where q is above that.
  // `profile` is convex in the distance and infinite beyond `radius`.
  template <typename Profile>
  static bool above(const Sweep& s, const Vec3& q, double radius, const Profile& profile) {
    const Vec3 rel = q - s.a;
    const double w = s.n.dot(rel);
    const Vec3 side = rel - w * s.n;
    const double t0 = s.square > 0 ? side.dot(s.across) / s.square : 0.0;
    const double off_square = (side - t0 * s.across).squaredNorm();
    if (off_square > radius * radius) return false;
    double lo = 0, hi = 1;
    if (s.square > 0) {
      const double reach = std::sqrt((radius * radius - off_square) / s.square);
      lo = std::max(0.0, t0 - reach);
      hi = std::min(1.0, t0 + reach);
      if (lo > hi) return false;
    }
    const auto height = [&](double t) {
      return t * s.level + profile(std::sqrt(off_square + (t - t0) * (t - t0) * s.square));
    };
    if (w >= height(std::clamp(t0, lo, hi))) return true;
    if (s.level == 0 || w < std::min(lo * s.level, hi * s.level)) return false;
    for (int k = 0; k < 12; ++k) {
      const double p = lo + (hi - lo) / 3, r = hi - (hi - lo) / 3;
      const double at_p = height(p), at_r = height(r);
      if (w >= std::min(at_p, at_r)) return true;
      (at_p < at_r ? hi : lo) = at_p < at_r ? r : p;
    }
    return false;
  }
  static Box3 box_of(const Sweep& s, double radius, double low, double high) {
    Box3 box;
    for (const Vec3& tip : {s.a, s.b}) {
      for (const double h : {low, high}) {
        const Vec3 middle = tip + h * s.n;
        Vec3 reach;
        for (int k = 0; k < 3; ++k) {
          reach[k] = radius * std::sqrt(std::max(0.0, 1 - s.n[k] * s.n[k])) + 0.05;
        }
        box.extend(Vec3(middle - reach));
        box.extend(Vec3(middle + reach));
      }
    }
    return box;
  }
  // Whether a cylinder of the tool, `low` to `high` above its tip, meets material or fixture by
  // more than 0.1 mm.
  bool body_meets(const Vec3& a, const Vec3& b, double radius, double low, double high) const {
    const Sweep s = sweep(a, b);
    const double r = radius - 0.1, from = low + 0.1;
    if (r <= 0) return false;
    const auto flat = [&](double) { return from; };
    const Box3 box = box_of(s, r, low, high);
    const double lowest = std::min(s.n.dot(a), s.n.dot(b)) + from;
    const bool met =
        top_along(s.n, room_) >= lowest &&
        out_.part.any(box, s.n, lowest, [&](const Vec3& q) { return above(s, q, r, flat); });
    return met || (top_along(s.n, fixture_box_) >= lowest && fixture_meets(s, box, r, flat));
  }
  static double top_along(const Vec3& n, const Box3& box) {
    double top = 0;
    for (int k = 0; k < 3; ++k) top += n[k] * (n[k] > 0 ? box.max()[k] : box.min()[k]);
    return top;
  }
  template <typename Profile>
  bool fixture_meets(const Sweep& s, const Box3& box, double r, const Profile& profile) const {
    if (!box.intersects(fixture_box_)) return false;
    return std::any_of(fixture_.begin(), fixture_.end(),
                       [&](const Vec3& p) { return box.contains(p) && above(s, p, r, profile); });
  }
  bool stack_meets(const std::vector<ToolSection>& stack, double from, const Vec3& a,
                   const Vec3& b) const {
    for (const ToolSection& section : stack) {
      if (section.z_to_mm <= from) continue;
      const double radius = std::min(section.r_from_mm, section.r_to_mm);
      if (body_meets(a, b, radius, std::max(from, section.z_from_mm), section.z_to_mm)) return true;
    }
    return false;
  }
  double ball(double distance, double shrink) const {
    const double r = 0.5 * rig_.cutter.diameter_mm - shrink;
    return shrink + r - std::sqrt(std::max(0.0, r * r - distance * distance));
  }
  // Whether the cutter, smaller by 0.1 mm, is in material or fixture.
  bool cutter_meets(const Vec3& a, const Vec3& b, bool stock) const {
    const Sweep s = sweep(a, b);
    const double r = 0.5 * rig_.cutter.diameter_mm - 0.1;
    const auto profile = [&](double distance) { return ball(distance, 0.1); };
    const Box3 box = box_of(s, r, 0, rig_.cutter.flute_length_mm);
    const double lowest = std::min(s.n.dot(a), s.n.dot(b)) + 0.1;
    const bool met = stock && out_.part.any(box, s.n, lowest,
                                            [&](const Vec3& q) { return above(s, q, r, profile); });
    return met || fixture_meets(s, box, r, profile);
  }

  void mill(const Vec3& from, const Vec3& to) {
    if (extruding_) broken(rapid_ ? "travel while extruding" : "extrusion with the module closed");
    if (rules_only_) return;
    const Vec3 a = to_part(from), b = to_part(to);
    const Vec3 parked(rig_.nozzle.parked_offset_mm.x, rig_.nozzle.parked_offset_mm.y,
                      rig_.nozzle.parked_offset_mm.z);
    if (stack_meets(rig_.cutter.holder, rig_.cutter.flute_length_mm, a, b)) broken("holder");
    if (stack_meets(rig_.nozzle.body, 0, to_part(from + parked), to_part(to + parked))) {
      broken("parked nozzle");
    }
    if (rapid_ && cutter_meets(a, b, true)) broken("rapid in material");
    if (cutter_meets(a, b, false)) broken("cutter in fixture");
    if (!rapid_ && (!spindle_ || spun_s_ < rig_.spindle.spin_up_s - 0.02) &&
        cutter_meets(a, b, true)) {
      broken("spindle not turning");
    }
    const Sweep s = sweep(a, b);
    const double r = 0.5 * rig_.cutter.diameter_mm;
    std::vector<std::array<int, 3>> gone;
    const auto profile = [&](double distance) { return ball(distance, 0); };
    out_.part.each(box_of(s, r, 0, rig_.cutter.flute_length_mm), false, [&](int i, int j, int k) {
      if (above(s, out_.part.centre(i, j, k), r, profile)) gone.push_back({i, j, k});
    });
    for (const auto& [i, j, k] : gone) {
      out_.part.set(i, j, k, false);
      if (deep(i, j, k)) broken("gouge");
    }
  }
  // 0.1 mm and more inside what is to be kept.
  bool deep(int i, int j, int k) const {
    return kept_.at(i, j, k) && kept_.at(i - 2, j, k) && kept_.at(i + 2, j, k) &&
           kept_.at(i, j - 2, k) && kept_.at(i, j + 2, k) && kept_.at(i, j, k - 2) &&
           kept_.at(i, j, k + 2);
  }

  void print(const Vec3& from, const Vec3& to) {
    const auto& o = rig_.nozzle.deployed_offset_mm;
    const Vec3 offset(o.x, o.y, o.z);
    const Vec3 a = to_part(from + offset), b = to_part(to + offset);
    if (!rules_only_) judge_print_bodies(a, b, to_part(from), to_part(to));
    const double across = (to - from).head<2>().norm();
    if (!extruding_) {
      if (!rapid_ && (dry_ += across) > rig_.extrusion.coast_mm + 1.05) broken("dry move");
      if (rapid_ && mouth_ &&
          (travel_ += across) > rig_.extrusion.travel_without_retract_mm + 0.01) {
        broken("travel without retraction");
      }
      return;
    }
    if (rapid_) return broken("travel while extruding");
    const double width =
        rate_ * section() / rig_.extrusion.multiplier / (feed_ * rig_.extrusion.layer_height_mm);
    if (std::fabs(width / rig_.extrusion.bead_width_mm - 1) > 0.26) return broken("flow");
    if (!rules_only_) lay(a, b, width);
  }
  // Nozzle tip from a to b, cutter tip from ca to cb.
  void judge_print_bodies(const Vec3& a, const Vec3& b, const Vec3& ca, const Vec3& cb) {
    if (stack_meets(rig_.nozzle.body, 0, a, b)) broken("nozzle");
    if (body_meets(a, b, 0.5 * rig_.nozzle.outlet_diameter_mm, 0, 0.2)) broken("nozzle drags");
    if (stack_meets(rig_.cutter.holder, rig_.cutter.flute_length_mm, ca, cb)) broken("holder");
    if (cutter_meets(ca, cb, true)) broken("idle cutter");
  }
  void lay(const Vec3& a, const Vec3& b, double width) {
    const Sweep s = sweep(a, b);
    const double h = rig_.extrusion.layer_height_mm;
    const int pieces = std::max(1, static_cast<int>(std::ceil((b - a).norm() / 0.5)));
    for (int piece = 0; piece < pieces; ++piece) {
      const Vec3 p = a + (b - a) * (static_cast<double>(piece) / pieces);
      const Vec3 q = a + (b - a) * (static_cast<double>(piece + 1) / pieces);
      hangs(sweep(p, q), width, h, (q - p).norm());
    }
    std::vector<std::array<int, 3>> filled;
    const Box3 box = box_of(s, 0.5 * width, -h, 0);
    if (!Box3(
             out_.part.origin,
             out_.part.origin + Cubes::kSize * Vec3(out_.part.n[0], out_.part.n[1], out_.part.n[2]))
             .contains(box)) {
      broken("a bead far from the part");
    }
    out_.part.each(box, true, [&](int i, int j, int k) {
      const Vec3 c = out_.part.centre(i, j, k);
      const Vec3 rel = c - s.a;
      const double w = s.n.dot(rel);
      const Vec3 side = rel - w * s.n;
      const double t = s.square > 0 ? std::clamp(side.dot(s.across) / s.square, 0.0, 1.0) : 0.0;
      if ((side - t * s.across).norm() > 0.5 * width) return;
      const double above_tip = w - t * s.level;
      if (above_tip <= 0 && above_tip >= -h) filled.push_back({i, j, k});
    });
    for (const auto& [i, j, k] : filled) out_.part.set(i, j, k, true);
  }
  // A piece of bead with nothing beneath, for longer than infill's gaps, hangs.
  void hangs(const Sweep& s, double width, double h, double length) {
    bool held = false;
    out_.part.each(box_of(s, 0.5 * width, -1.9 * h, -0.3 * h), false, [&](int i, int j, int k) {
      if (held) return;
      const Vec3 rel = out_.part.centre(i, j, k) - s.a;
      const double w = s.n.dot(rel);
      held = w < -0.3 * h && w > -1.9 * h && (rel - w * s.n).norm() < width + length;
    });
    hanging_ = held ? 0 : hanging_ + length;
    if (hanging_ > 2 * std::max(2.0, 2 * rig_.extrusion.bead_width_mm / rig_.extrusion.infill)) {
      broken("a bead in the air");
    }
  }

  // Points on the fixture, about a millimetre apart.
  void sample_fixture() {
    for (const auto& t : in_.fixture->triangles) {
      const Vec3 &a = in_.fixture->vertices[t[0]], &b = in_.fixture->vertices[t[1]],
                 &c = in_.fixture->vertices[t[2]];
      const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
      for (const Vec3& p : {a, b, c}) fixture_box_.extend(p);
      const int steps = std::clamp(static_cast<int>(std::ceil(longest)), 1, 60);
      for (int i = 0; i <= steps; ++i) {
        for (int j = 0; i + j <= steps; ++j) {
          fixture_.push_back(a + (b - a) * (static_cast<double>(i) / steps) +
                             (c - a) * (static_cast<double>(j) / steps));
        }
      }
    }
  }

  const VerifyInputs& in_;
  const RigDescription& rig_;
  ReferenceOutcome out_;
  Cubes kept_;
  std::vector<Vec3> outline_, fixture_;
  Box3 room_, fixture_box_;  // of initial and target with what beads may add; of the fixture
  std::size_t line_ = 0;
  bool rules_only_ = false;
  bool rapid_ = false, moded_ = false, relative_ = false, unit_said_ = false,
       distance_said_ = false;
  double inch_ = 1, feed_ = 0, speed_ = 0;
  bool spindle_ = false, open_ = false, extruding_ = false, retracting_ = false, mouth_ = false,
       ended_ = false;
  double rate_ = 0, dry_ = 0, travel_ = 0, spun_s_ = 0, hanging_ = 0;
  std::array<std::optional<double>, 3> at_{};
  double tilt_ = 0, c_ = 0;
};

// What a fault did, if it did anything: empty, or the reason. `good` is the outcome without it.
inline std::string change(const ReferenceOutcome& good, const ReferenceOutcome& is) {
  if (!is.broken.empty()) return is.broken;
  std::size_t cubes = 0;
  Cubes differs = good.part;
  for (std::size_t w = 0; w < differs.bits.size(); ++w) {
    differs.bits[w] ^= is.part.bits[w];
    cubes += static_cast<std::size_t>(__builtin_popcountll(differs.bits[w]));
  }
  const double volume = static_cast<double>(cubes) * std::pow(Cubes::kSize, 3);
  if (volume > 0.5) return "volume differs by " + std::to_string(volume) + " mm3";
  bool thick = false;  // somewhere four cubes in every direction
  const Box3 everywhere(differs.origin, Vec3(differs.origin + Vec3::Constant(1e3)));
  differs.each(everywhere, false, [&](int i, int j, int k) {
    if (thick) return;
    for (int c = 0; c < 4; ++c) {
      for (int b = 0; b < 4; ++b) {
        for (int a = 0; a < 4; ++a) {
          if (!differs.at(i + a, j + b, k + c)) return;
        }
      }
    }
    thick = true;
  });
  return thick ? "deviation over 0.15 mm" : "";
}

// Room for the part and everything near it.
inline Box3 room_of(const VerifyInputs& inputs) {
  Box3 box;
  for (const Vec3& p : inputs.initial.vertices) box.extend(p);
  for (const Vec3& p : inputs.target->vertices) box.extend(p);
  return Box3(box.min() - Vec3::Constant(3), box.max() + Vec3::Constant(3));
}

}  // namespace reforge::mutation
