#include "protocols/certificate.h"

#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>

namespace reforge {
namespace {

using Json = nlohmann::json;  // keys sorted
constexpr const char* kFormat = "reforge-certificate 1";

double rounded(double value) {
  const double r = std::round(value * 1e4) / 1e4;
  return r == 0 ? 0.0 : r;  // no -0
}

Json numbers(const std::map<std::string, double>& values) {
  Json json = Json::object();
  for (const auto& [key, value] : values) json[key] = rounded(value);
  return json;
}

Json to_json(const CertificateVolumes& v) {
  return numbers({{"reused", v.reused}, {"removed", v.removed}, {"added", v.added}});
}

Json to_json(const CertificateFinding& f) {
  return {{"kind", f.kind},
          {"count", f.count},
          {"worst",
           {{"line", f.line},
            {"block", f.block},
            {"position", {rounded(f.position.x), rounded(f.position.y), rounded(f.position.z)}},
            {"depth_mm", rounded(f.depth_mm)},
            {"sentence", f.sentence}}}};
}

CertificateVolumes volumes_of(const Json& json) {
  return {json.at("reused").get<double>(), json.at("removed").get<double>(),
          json.at("added").get<double>()};
}

CertificateFinding finding_of(const Json& json) {
  CertificateFinding f;
  f.kind = json.at("kind").get<std::string>();
  f.count = json.at("count").get<std::uint64_t>();
  const Json& worst = json.at("worst");
  f.line = worst.at("line").get<std::size_t>();
  f.block = worst.at("block").get<int>();
  f.position = {worst.at("position").at(0).get<double>(), worst.at("position").at(1).get<double>(),
                worst.at("position").at(2).get<double>()};
  f.depth_mm = worst.at("depth_mm").get<double>();
  f.sentence = worst.at("sentence").get<std::string>();
  return f;
}

// Either value, or a Json::exception for anything else.
bool one_of(const std::string& value, const char* yes, const char* no) {
  if (value != yes && value != no) {
    throw Json::other_error::create(
        500, "'" + value + "' where " + yes + " or " + no + " was expected", nullptr);
  }
  return value == yes;
}

Certificate certificate_of(const Json& json) {
  Certificate c;
  c.sha256 = json.at("sha256").get<std::map<std::string, std::string>>();
  c.mode =
      one_of(json.at("mode").get<std::string>(), "paper", "strict") ? Mode::kPaper : Mode::kStrict;
  c.verifier = json.at("verifier").get<std::string>();
  c.pitch_mm = json.at("pitch_mm").get<double>();
  c.pass = one_of(json.at("verdict").get<std::string>(), "pass", "fail");
  for (const Json& f : json.at("findings")) c.findings.push_back(finding_of(f));
  const Json& program = json.at("program");
  c.lines = program.at("lines").get<std::size_t>();
  c.moves = program.at("moves").get<std::size_t>();
  c.blocks = program.at("blocks").get<int>();
  c.filament_mm = program.at("filament_mm").get<double>();
  const Json& volumes = json.at("volumes_mm3");
  if (!volumes.at("planned").is_null()) c.planned = volumes_of(volumes.at("planned"));
  c.simulated = volumes_of(volumes.at("simulated"));
  c.volume_details_mm3 = volumes.at("details").get<std::map<std::string, double>>();
  c.deviation_mm =
      json.at("deviation_mm").get<std::map<std::string, std::map<std::string, double>>>();
  c.clearance_mm = json.at("clearance_mm").get<std::map<std::string, double>>();
  c.seconds = json.at("seconds").get<double>();
  return c;
}

}  // namespace

std::string canonical_json(const Certificate& c) {
  Json findings = Json::array();
  for (const CertificateFinding& f : c.findings) findings.push_back(to_json(f));
  Json deviation = Json::object();
  for (const auto& [surface, values] : c.deviation_mm) deviation[surface] = numbers(values);
  const Json json = {
      {"format", kFormat},
      {"sha256", c.sha256},
      {"mode", c.mode == Mode::kPaper ? "paper" : "strict"},
      {"verifier", c.verifier},
      {"pitch_mm", rounded(c.pitch_mm)},
      {"verdict", c.pass ? "pass" : "fail"},
      {"findings", findings},
      {"program",
       {{"lines", c.lines},
        {"moves", c.moves},
        {"blocks", c.blocks},
        {"filament_mm", rounded(c.filament_mm)}}},
      {"volumes_mm3",
       {{"planned", c.planned ? to_json(*c.planned) : Json()},
        {"simulated", to_json(c.simulated)},
        {"details", numbers(c.volume_details_mm3)}}},
      {"deviation_mm", deviation},
      {"clearance_mm", numbers(c.clearance_mm)},
      {"seconds", rounded(c.seconds)},
  };
  // A sentence may quote a byte of the program: what is no UTF-8 is replaced.
  return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<Certificate> parse_certificate(std::string_view text, const std::string& name) {
  try {
    const Json json = Json::parse(text);
    const std::string format = json.at("format").get<std::string>();
    if (format != kFormat) {
      return Result<Certificate>::fail(Code::kWrongVersion, name + ": the format is '" + format +
                                                                "'; expected '" + kFormat + "'");
    }
    static const std::set<std::string> kKeys{
        "format",   "sha256",  "mode",        "verifier",     "pitch_mm",     "verdict",
        "findings", "program", "volumes_mm3", "deviation_mm", "clearance_mm", "seconds"};
    for (const auto& [key, value] : json.items()) {
      if (kKeys.count(key) == 0) {
        return Result<Certificate>::fail(Code::kUnknownKey, name + ": unknown key '" + key + "'");
      }
    }
    return certificate_of(json);
  } catch (const Json::exception& e) {
    return Result<Certificate>::fail(Code::kMalformed, name + ": " + e.what());
  }
}

Result<Certificate> read_certificate(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (!in) {
    return Result<Certificate>::fail(Code::kUnreadable,
                                     file.string() + ": the certificate cannot be read");
  }
  return parse_certificate(text, file.string());
}

}  // namespace reforge
