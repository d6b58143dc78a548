#include "protocols/rig.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "protocols/sha256.h"

namespace reforge {
namespace {

const std::filesystem::path kShipped = std::filesystem::path(REFORGE_SOURCE_DIR) / "config/rigs";

std::string shipped_text() {
  std::ifstream in(kShipped / "mx220.json", std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// The shipped file with one piece of text replaced.
Error error_after(const std::string& from, const std::string& to) {
  std::string text = shipped_text();
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  const auto rig = parse_rig(text, "rig.json");
  EXPECT_FALSE(rig.ok()) << from << " -> " << to;
  return rig.ok() ? Error{Code::kUsage, ""} : rig.error();
}

TEST(Rig, TheShippedFileIsRead) {
  const auto rig = read_rig(kShipped / "mx220.json");
  ASSERT_TRUE(rig.ok()) << rig.error().sentence;
  EXPECT_EQ(rig->name, "mx220");
  EXPECT_EQ(rig->sha256, sha256_hex(shipped_text()));
  EXPECT_FALSE(rig->commissioned.has_value());
  EXPECT_EQ(rig->kinematics.table, RotaryTable::kBC);
  EXPECT_EQ(rig->kinematics.tilt_offset_mm.z, -10);
  EXPECT_EQ(rig->nozzle.deployed_offset_mm.z, -5);
  EXPECT_EQ(rig->cnc.receive_buffer_bytes, 128);
  EXPECT_EQ(rig->cnc.m_codes, MCodeRoute::kRelay);
  EXPECT_EQ(rig->cutter.holder.size(), 3u);
}

TEST(Rig, FileUnitsBecomeMillimetresSecondsAndRadians) {
  const auto rig = read_rig(kShipped / "mx220.json");
  ASSERT_TRUE(rig.ok());
  EXPECT_DOUBLE_EQ(rig->x.rapid_mm_per_s, 50);
  EXPECT_DOUBLE_EQ(rig->cutter.feed_mm_per_s, 800.0 / 60);
  EXPECT_DOUBLE_EQ(rig->tilt.max.in_degrees(), 110);
  EXPECT_DOUBLE_EQ(rig->tilt.rapid_rad_per_s, std::numbers::pi / 3);
  EXPECT_DOUBLE_EQ(rig->c.acceleration_rad_per_s2, 2 * std::numbers::pi);
  EXPECT_DOUBLE_EQ(rig->extrusion.feed_mm_per_s, 500.0 / 60);
  EXPECT_DOUBLE_EQ(rig->extrusion.nozzle_temperature.value(), 205);
}

TEST(Rig, AnUnknownKeyIsNamedWithItsPath) {
  const Error e = error_after("\"sign_c\": 1,", "\"sign_c\": 1, \"sign_b\": 1,");
  EXPECT_EQ(e.code, Code::kUnknownKey);
  EXPECT_EQ(e.sentence, "rig.json: kinematics.sign_b is no key this version knows");
}

TEST(Rig, AMissingKeyIsNamedWithItsPath) {
  const Error e = error_after("\"sign_c\": 1,", "");
  EXPECT_EQ(e.code, Code::kMalformed);
  EXPECT_EQ(e.sentence, "rig.json: kinematics.sign_c is missing");
}

TEST(Rig, ANumberOutOfRangeSaysTheRange) {
  const Error e = error_after("\"infill\": 0.3", "\"infill\": 30");
  EXPECT_EQ(e.code, Code::kOutOfRange);
  EXPECT_EQ(e.sentence, "rig.json: extrusion.infill is 30 but must lie between 0 and 1");
}

TEST(Rig, AWrongTypeAWrongVersionAndADuplicateAreRefused) {
  EXPECT_EQ(error_after("\"infill\": 0.3", "\"infill\": \"0.3\"").code, Code::kMalformed);
  EXPECT_EQ(error_after("reforge-rig 1", "reforge-rig 2").code, Code::kWrongVersion);
  EXPECT_EQ(error_after("\"sign_c\": 1", "\"sign_c\": 1, \"sign_c\": -1").code, Code::kMalformed);
  EXPECT_EQ(error_after("\"sign_c\": 1", "\"sign_c\": 0").code, Code::kOutOfRange);
  EXPECT_EQ(error_after("\"sign_c\": 1", "\"sign_c\": 0.5").code, Code::kOutOfRange);
  EXPECT_EQ(error_after("\"dialect\": \"grbl\"", "\"dialect\": \"klipper\"").code,
            Code::kOutOfRange);
  EXPECT_EQ(error_after("\"cnc\",", "\"cncs\",").code, Code::kUnknownKey);
  EXPECT_EQ(error_after("{", "[{").code, Code::kMalformed);
}

TEST(Rig, ValuesThatContradictEachOtherAreRefused) {
  EXPECT_EQ(error_after("\"min_mm\": -130", "\"min_mm\": 130").code, Code::kOutOfRange);
  EXPECT_EQ(error_after("\"z_from_mm\": 26.5", "\"z_from_mm\": 27").code, Code::kOutOfRange);
  EXPECT_EQ(error_after("\"tilt_offset_mm\": [0, 0, -10]", "\"tilt_offset_mm\": [0, 1, -10]").code,
            Code::kOutOfRange);
  EXPECT_EQ(error_after("\"nozzle_temperature_c\": 205", "\"nozzle_temperature_c\": 300").code,
            Code::kOutOfRange);
  EXPECT_EQ(error_after("\"spindle_rpm\": 12000", "\"spindle_rpm\": 1200").code, Code::kOutOfRange);
}

TEST(Rig, CommissioningIsReadWhenStated) {
  std::string text = shipped_text();
  const std::string none = "\"commissioned\": null";
  text.replace(text.find(none), none.size(),
               R"("commissioned": {"by": "A. B.", "date": "2024-05-01", "note": "dial gauge"})");
  const auto rig = parse_rig(text, "rig.json");
  ASSERT_TRUE(rig.ok()) << rig.error().sentence;
  EXPECT_EQ(rig->commissioned.value().by, "A. B.");
}

TEST(Rig, AFileThatIsNotThereIsNamed) {
  const auto rig = read_rig("no-such-rig.json");
  ASSERT_FALSE(rig.ok());
  EXPECT_EQ(rig.error().code, Code::kUnreadable);
  EXPECT_NE(rig.error().sentence.find("no-such-rig.json"), std::string::npos);
}

// RIG.md: cutter heights count from the ball's centre there (1.5 mm above the tip), from the tip
// here.
TEST(Rig, ThePapersToolsAreThePublishedOnes) {
  const auto rig = read_rig(kShipped / "mx220.json");
  ASSERT_TRUE(rig.ok());
  const CutterDescription cutter = paper_cutter(rig->cutter);
  ASSERT_EQ(cutter.holder.size(), 3u);
  EXPECT_DOUBLE_EQ(cutter.holder[0].z_from_mm, 1.5 + 1.5);
  EXPECT_DOUBLE_EQ(cutter.holder[0].r_from_mm, 1.5);
  EXPECT_DOUBLE_EQ(cutter.holder[1].z_from_mm, 1.5 + 14.5);
  EXPECT_DOUBLE_EQ(cutter.holder[1].r_to_mm, 25);
  EXPECT_DOUBLE_EQ(cutter.holder[2].z_from_mm, 1.5 + 44.5);
  EXPECT_TRUE(std::isinf(cutter.holder[2].r_from_mm));
  EXPECT_TRUE(std::isinf(cutter.holder[2].z_to_mm));
  EXPECT_DOUBLE_EQ(cutter.feed_mm_per_s, rig->cutter.feed_mm_per_s);
  const NozzleDescription nozzle = paper_nozzle(rig->nozzle);
  ASSERT_EQ(nozzle.body.size(), 3u);
  EXPECT_DOUBLE_EQ(nozzle.body[0].z_from_mm, 0.2);
  EXPECT_DOUBLE_EQ(nozzle.body[0].r_from_mm, 2);
  EXPECT_DOUBLE_EQ(nozzle.body[1].z_to_mm, 10.2);
  EXPECT_TRUE(std::isinf(nozzle.body[2].r_to_mm));
  EXPECT_DOUBLE_EQ(nozzle.deployed_offset_mm.x, 90);
}

TEST(Sha256, KnownAnswers) {
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(Sha256, AFileHashesAsItsBytes) {
  const auto hash = sha256_of_file(kShipped / "mx220.json");
  ASSERT_TRUE(hash.ok());
  EXPECT_EQ(*hash, sha256_hex(shipped_text()));
  EXPECT_FALSE(sha256_of_file("no-such-file").ok());
}

}  // namespace
}  // namespace reforge
