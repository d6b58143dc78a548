#include "protocols/certificate.h"

#include <gtest/gtest.h>

namespace reforge {
namespace {

Certificate sample() {
  Certificate c;
  c.sha256 = {{"program", "aa"}, {"rig", "bb"}};
  c.mode = Mode::kPaper;
  c.verifier = "0.1.0";
  c.pitch_mm = 0.1;
  c.pass = false;
  c.findings.push_back({"gouge", 3, 42, 2, {1, -2.00004, 3}, 0.3, "a \"gouge\""});
  c.lines = 100;
  c.moves = 90;
  c.blocks = 2;
  c.planned = CertificateVolumes{1, 2, 3};
  c.simulated = {1.00001, 2, -0.00001};
  c.volume_details_mm3 = {{"initial", 3}};
  c.deviation_mm = {{"milled", {{"p50", 0.01}}}};
  c.clearance_mm = {{"holder to stock", 1.5}};
  c.seconds = 12.34567;
  return c;
}

TEST(Certificate, IsCanonicalJson) {
  const std::string text = canonical_json(sample());
  EXPECT_EQ(text.back(), '\n');
  EXPECT_EQ(text.find(": "), std::string::npos);
  EXPECT_EQ(text.find("{\"blocks\""), text.find("\"program\":") + 10);  // sorted
  EXPECT_NE(text.find("\"seconds\":12.3457,"), std::string::npos);
  EXPECT_NE(text.find("\"added\":0.0"), std::string::npos);  // never -0
}

TEST(Certificate, ReadsBackToTheSameBytes) {
  const std::string text = canonical_json(sample());
  const Result<Certificate> read = parse_certificate(text, "test");
  ASSERT_TRUE(read) << read.error().sentence;
  EXPECT_EQ(canonical_json(*read), text);
  EXPECT_EQ(read->findings.at(0).count, 3u);
  EXPECT_EQ(read->mode, Mode::kPaper);
}

TEST(Certificate, RefusesAnotherFormatAnUnknownKeyAndAMissingOne) {
  const std::string text = canonical_json(sample());
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    return parse_certificate(changed, "test");
  };
  EXPECT_EQ(with("reforge-certificate 1", "reforge-certificate 2").error().code,
            Code::kWrongVersion);
  EXPECT_FALSE(with("\"seconds\"", "\"secunds\""));
  EXPECT_FALSE(with("\"verdict\":\"fail\"", "\"verdict\":\"maybe\""));
  EXPECT_FALSE(parse_certificate("{", "test"));
}

TEST(Certificate, BytesThatAreNoTextDoNotBreakIt) {
  Certificate c = sample();
  c.findings[0].sentence = "found \xff here";
  EXPECT_TRUE(parse_certificate(canonical_json(c), "test"));
}

}  // namespace
}  // namespace reforge
