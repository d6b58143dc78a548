// A small world for the verifier's tests: a block that is faced to z = 6, milled on its +X side to
// x = 9 with B = 90, and gets a pad of 8 x 8 x 2 mm printed on top; on a pedestal over the table's
// disc. The program is written out by hand so that each test can break one line of it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <sstream>
#include <string>
#include <vector>

#include "planner/geometry/shapes.h"
#include "planner/verify/verify.h"

namespace reforge::verify {

inline TriangleMesh together(const TriangleMesh& a, const TriangleMesh& b) {
  TriangleMesh all = a;
  const auto shift = static_cast<std::uint32_t>(a.vertices.size());
  all.vertices.insert(all.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (auto t : b.triangles) {
    for (auto& corner : t) corner += shift;
    all.triangles.push_back(t);
  }
  return all;
}

struct World {
  VerifyInputs inputs;
  std::vector<std::string> lines;

  World() {
    Result<RigDescription> rig =
        read_rig(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json");
    EXPECT_TRUE(rig) << (rig ? "" : rig.error().sentence);
    inputs.rig = std::move(*rig);
    inputs.initial = make_box({-10, -10, 0}, {10, 10, 10});
    inputs.reused = make_box({-10, -10, 0}, {9, 10, 6});
    inputs.removed =
        together(make_box({-10, -10, 6}, {10, 10, 10}), make_box({9, -10, 0}, {10, 10, 6}));
    inputs.added = make_box({-4, -4, 6}, {4, 4, 8});
    inputs.target = together(*inputs.reused, *inputs.added);
    inputs.fixture = together(make_box({-7, -7, -50}, {6, 7, 0}),
                              make_cylinder({0, 0, -62}, {0, 0, -50}, 25, 48));
    write();
  }

  void put(const char* format, double a = 0, double b = 0, double c = 0) {
    char text[120];
    std::snprintf(text, sizeof text, format, a, b, c);
    lines.push_back(text);
  }

  void write() {
    put("G21 G90 G94 G17 G54");
    put("G0 Z80");
    put("G0 B0 C0");
    put("; block 01 mill direction 0.000000 0.000000 1.000000");
    put("M3 S12000");
    put("G4 P2");
    put("; path 1");
    put("G0 X-13 Y-13");
    put("G0 Z6");
    for (int k = 0; k <= 47; ++k) {
      const double y = -11.75 + 0.5 * k;
      put("G1 Y%.3f F800", y);
      put(k % 2 == 0 ? "G1 X12" : "G1 X-12");
    }
    put("G0 Z80");
    put("; block 02 mill direction 1.000000 0.000000 0.000000");
    put("G0 B90 C0");
    put("; path 2");
    put("G0 X-20 Y-13");
    put("G0 Z-1");
    for (int k = 0; k <= 18; ++k) {
      put("G1 X%.3f F800", -18 + 0.5 * k);  // part z from 8 down to -1
      put(k % 2 == 0 ? "G1 Y13" : "G1 Y-13");
    }
    put("G0 Z80");
    put("M5");
    put("; block 03 print direction 0.000000 0.000000 1.000000");
    put("G0 B0 C0");
    put("M70 S205");
    for (int layer = 1; layer <= 10; ++layer) {
      put("; path %.0f", 2 + layer);
      put("G0 X-93.75 Y-3.75");
      put("G0 Z%.3f", 11 + 0.2 * layer);
      put("M72 P0.3465");
      put("G4 P0.1");
      for (int k = 0; k <= 15; ++k) {
        put("G1 Y%.3f F500", -3.75 + 0.5 * k);
        put(k % 2 == 0 ? "G1 X-86.25" : "G1 X-93.75");
      }
      put("M73");
      put("G1 X-93.55");
      put("M74 P1.0");
      put("M75");
    }
    put("G0 Z80");
    put("M71");
    put("M30");
  }

  // Where the n-th line with exactly this text stands.
  std::size_t find(const std::string& text, int n = 0) const {
    for (std::size_t k = 0; k < lines.size(); ++k) {
      if (lines[k] == text && n-- == 0) return k;
    }
    ADD_FAILURE() << "no line '" << text << "'";
    return 0;
  }
  void drop(const std::string& text, int n = 0) {
    lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(find(text, n)));
  }
  void replace(const std::string& text, const std::string& with, int n = 0) {
    lines[find(text, n)] = with;
  }
  void insert_before(const std::string& text, const std::string& extra, int n = 0) {
    lines.insert(lines.begin() + static_cast<std::ptrdiff_t>(find(text, n)), extra);
  }

  std::string text() const {
    std::string all;
    for (const std::string& line : lines) all += line + "\n";
    return all;
  }

  Verification verify(double pitch = 0.2) const {
    std::istringstream in(text());
    VerifyOptions options;
    options.pitch_mm = pitch;
    Result<Verification> v = verify_program(in, inputs, options);
    EXPECT_TRUE(v) << (v ? "" : v.error().sentence);
    return std::move(*v);
  }
};

// Every finding as text, for messages of tests.
inline std::string all_of(const Verification& v) {
  std::string text;
  for (std::size_t k = 0; k < kFaults; ++k) {
    const Findings::Kind& kind = v.findings.of(static_cast<Fault>(k));
    if (kind.count == 0) continue;
    text += std::string(name_of(static_cast<Fault>(k))) + " x" + std::to_string(kind.count) +
            " line " + std::to_string(kind.worst.line) + ": " + kind.worst.sentence + "\n";
  }
  return text;
}

}  // namespace reforge::verify
