// The verifier's verdict on a program, bound by hash to everything it was reached with.
//
// Canonical JSON (FORMATS.md, "certificate.json"): sorted keys, no spaces, numbers rounded to 1e-4,
// `\n` at the end, so that the same verification gives the same bytes. The daemon runs a program
// only if `verdict` is pass, the hashes are those of the files it holds, and its own verification
// gives the same bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"
#include "protocols/rig.h"

namespace reforge {

struct CertificateFinding {
  std::string kind;         // "gouge", "axis_limit", ...
  std::uint64_t count = 0;  // of this kind; the rest describes the worst
  std::size_t line = 0;     // of the program, from 1; 0: of the whole
  int block = 0;
  Point<PartFrame> position;
  double depth_mm = 0;
  std::string sentence;
};

struct CertificateVolumes {
  double reused = 0, removed = 0, added = 0;  // mm^3
};

struct Certificate {
  std::map<std::string, std::string>
      sha256;  // program, rig, initial, target, ...: of files as read
  Mode mode = Mode::kStrict;
  std::string verifier;  // version
  double pitch_mm = 0;   // of the simulated stock
  bool pass = false;
  std::vector<CertificateFinding> findings;  // one per kind, by kind
  std::size_t lines = 0;
  std::size_t moves = 0;
  int blocks = 0;
  std::optional<CertificateVolumes> planned;
  CertificateVolumes simulated;
  std::map<std::string, double> volume_details_mm3;  // added_by_flow, kept_cut, ...
  std::map<std::string, std::map<std::string, double>> deviation_mm;  // milled, kept, printed
  std::map<std::string, double> clearance_mm;  // smallest gap per body and obstacle
  double seconds = 0;
  double filament_mm = 0;
};

std::string canonical_json(const Certificate& certificate);
Result<Certificate> parse_certificate(std::string_view text, const std::string& name_for_errors);
Result<Certificate> read_certificate(const std::filesystem::path& file);

}  // namespace reforge
