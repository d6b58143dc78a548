// Named quantities and framed points, for the seams where a wrong unit or frame would move metal.
//
// Inside: millimetres, seconds, radians. Degrees and mm/min exist only in files and in G-code.
// A bare double elsewhere carries its unit in its name (`feed_mm_per_s`, `timeout_ms`).
//
// Frames (RIG.md, "Kinematics"):
//   PartFrame     z up, z = 0 on the fabrication base the part stands on, fixed to the part.
//   MachineFrame  G54 work coordinates of the tool tip: equal to PartFrame when both rotary axes are 0.
// A Point<PartFrame> cannot meet a Point<MachineFrame> without a transform.
#pragma once

#include <compare>
#include <numbers>

namespace reforge {

class Radians {
 public:
  constexpr Radians() = default;
  static constexpr Radians of(double radians) { return Radians(radians); }
  static constexpr Radians degrees(double degrees) {
    return Radians(degrees * (std::numbers::pi / 180.0));
  }
  constexpr double value() const { return value_; }
  constexpr double in_degrees() const { return value_ * (180.0 / std::numbers::pi); }
  friend constexpr Radians operator-(Radians a) { return Radians(-a.value_); }
  friend constexpr Radians operator+(Radians a, Radians b) { return Radians(a.value_ + b.value_); }
  friend constexpr Radians operator-(Radians a, Radians b) { return Radians(a.value_ - b.value_); }
  friend constexpr auto operator<=>(Radians, Radians) = default;

 private:
  explicit constexpr Radians(double value) : value_(value) {}
  double value_ = 0;
};

class Celsius {
 public:
  constexpr Celsius() = default;
  static constexpr Celsius of(double degrees) { return Celsius(degrees); }
  constexpr double value() const { return value_; }
  friend constexpr auto operator<=>(Celsius, Celsius) = default;

 private:
  explicit constexpr Celsius(double value) : value_(value) {}
  double value_ = 0;
};

struct PartFrame;
struct MachineFrame;

// Millimetres in the named frame.
template <typename Frame>
struct Point {
  double x = 0;
  double y = 0;
  double z = 0;
  friend constexpr bool operator==(const Point&, const Point&) = default;
};

}  // namespace reforge
