// A finished job folder written by hand: tiny, whole, and bound to its certificate by real hashes.
// Its meshes are empty; what matters is the program.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "protocols/certificate.h"
#include "protocols/sha256.h"

namespace reforge::testing {

inline void write_file(const std::filesystem::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

inline std::string read_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline std::filesystem::path shipped_rig_file() {
  return std::filesystem::path(REFORGE_SOURCE_DIR) / "config/rigs/mx220.json";
}

// The comment lines a program begins with (FORMATS.md, "program.nc"), for the rig file given.
inline std::string program_header(const std::string& rig_bytes, const std::string& stock_bytes) {
  const std::string rig = sha256_hex(rig_bytes);
  const std::string stock = sha256_hex(stock_bytes);
  return "; reforge-program: 1\n; job: tiny\n; rig: mx220 " + rig +
         "\n; mode: strict\n; table: BC, tilt +1, c +1\n; pivot-r: X0.000 Y0.000 Z0.000\n"
         "; pivot-d: X0.000 Y0.000 Z-10.000\n; g54: X0.000 Y0.000 Z0.000\n; cutter: ball D3.000\n"
         "; nozzle: D0.500 offset X90.000 Y0.000 Z-5.000\n; stock: " +
         stock + "\n";
}

inline void write_certificate(const std::filesystem::path& folder, const Certificate& value) {
  write_file(folder / "certificate.json", canonical_json(value));
}

// `body`: the program behind its header.
inline void make_job(const std::filesystem::path& folder, const std::string& body) {
  std::filesystem::create_directories(folder);
  const std::string empty_stl(84, '\0');
  const std::string rig = read_file(shipped_rig_file());
  const std::string program = program_header(rig, empty_stl) + body;
  Certificate certificate;
  certificate.pass = true;
  certificate.seconds = 10.5;
  certificate.sha256 = {{"program", sha256_hex(program)}, {"rig", sha256_hex(rig)}};
  write_file(folder / "program.nc", program);
  write_file(folder / "rig.json", rig);
  for (const char* name : {"initial", "target", "fixture", "reused", "removed", "added"}) {
    write_file(folder / (std::string(name) + ".stl"), empty_stl);
    certificate.sha256[name] = sha256_hex(empty_stl);
  }
  write_file(folder / "plan.json", R"({"format":"reforge-plan 1"})");
  write_certificate(folder, certificate);
}

}  // namespace reforge::testing
