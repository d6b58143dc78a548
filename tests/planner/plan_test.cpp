// The whole chain on a pair small enough to read: a box becomes a step, in both modes.
#include "planner/program/plan.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "planner/geometry/mesh_io.h"
#include "planner/geometry/shapes.h"

namespace reforge {
namespace {

namespace fs = std::filesystem;

class PlanTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    ASSERT_TRUE(write_binary_stl(make_box({-7, -6, 0}, {7, 6, 10}), folder_ / "box.stl").ok());
    ASSERT_TRUE(write_binary_stl(make_box({-7, -6, 0}, {7, 6, 7}), folder_ / "low.stl").ok());
    ASSERT_TRUE(write_binary_stl(make_box({-7, -6, 0}, {7, 6, 12}), folder_ / "high.stl").ok());
  }
  void TearDown() override { fs::remove_all(folder_); }

  PlanRequest request(const std::string& initial, const std::string& target, Mode mode) const {
    PlanRequest r;
    r.initial = folder_ / initial;
    r.target = folder_ / target;
    r.rig = std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json";
    r.job = folder_ / "job";
    r.mode = mode;
    r.setup = Setup::kStored;
    r.effort = Effort::kFast;
    r.replace = true;
    return r;
  }
  std::string text(const std::string& name) const {
    std::ifstream in(folder_ / "job" / name, std::ios::binary);
    std::ostringstream bytes;
    bytes << in.rdbuf();
    return bytes.str();
  }
  bool drafts_left() const {
    for (const auto& entry : fs::directory_iterator(folder_)) {
      if (entry.path().filename().string().front() == '.') return true;
    }
    return false;
  }

  fs::path folder_;
};

TEST_F(PlanTest, LoweredBoxIsMilledAndPasses) {
  for (const Mode mode : {Mode::kStrict, Mode::kPaper}) {
    const auto outcome = plan(request("box.stl", "low.stl", mode));
    ASSERT_TRUE(outcome.ok()) << outcome.error().sentence;
    EXPECT_TRUE(outcome->feasible);
    EXPECT_TRUE(outcome->verified) << (outcome->reasons.empty() ? "" : outcome->reasons[0]);
    const auto json = nlohmann::json::parse(outcome->json);
    EXPECT_EQ(json.at("results").at("B_A"), 0);
    EXPECT_GE(json.at("results").at("B_S"), 1);
    EXPECT_NEAR(json.at("volumes_mm3").at("removed").get<double>(), 14 * 12 * 3, 0.1);
    EXPECT_TRUE(fs::exists(folder_ / "job" / "blocks" / "01-mill.stl"));
  }
}

TEST_F(PlanTest, RaisedBoxIsPrintedAndPasses) {
  const auto outcome = plan(request("box.stl", "high.stl", Mode::kStrict));
  ASSERT_TRUE(outcome.ok()) << outcome.error().sentence;
  EXPECT_TRUE(outcome->feasible);
  EXPECT_TRUE(outcome->verified) << (outcome->reasons.empty() ? "" : outcome->reasons[0]);
  const auto json = nlohmann::json::parse(outcome->json);
  EXPECT_EQ(json.at("results").at("B_S"), 0);
  EXPECT_EQ(json.at("results").at("B_A"), 1);
  EXPECT_GT(json.at("extrusion").at("filament_mm").get<double>(), 10);
}

TEST_F(PlanTest, SameSeedSameProgram) {
  ASSERT_TRUE(plan(request("box.stl", "low.stl", Mode::kStrict)).ok());
  const std::string first = text("program.nc"), certificate = text("certificate.json");
  ASSERT_TRUE(plan(request("box.stl", "low.stl", Mode::kStrict)).ok());
  EXPECT_EQ(text("program.nc"), first);
  EXPECT_EQ(text("certificate.json"), certificate);
}

TEST_F(PlanTest, IdenticalPartsNeedNoMotion) {
  const auto outcome = plan(request("box.stl", "box.stl", Mode::kStrict));
  ASSERT_TRUE(outcome.ok()) << outcome.error().sentence;
  EXPECT_TRUE(outcome->verified);
  EXPECT_EQ(text("program.nc").find("G0"), std::string::npos);
  EXPECT_EQ(text("program.nc").find("G1 "), std::string::npos);
}

TEST_F(PlanTest, ABadFileLeavesNothingBehind) {
  std::ofstream(folder_ / "bad.stl") << "no mesh at all";
  const auto outcome = plan(request("bad.stl", "low.stl", Mode::kStrict));
  ASSERT_FALSE(outcome.ok());
  EXPECT_NE(outcome.error().sentence.find("bad.stl"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / "job"));
  EXPECT_FALSE(drafts_left());
}

TEST_F(PlanTest, StoppingLeavesNothingBehind) {
  PlanRequest r = request("box.stl", "low.stl", Mode::kStrict);
  r.should_stop = [] { return true; };
  const auto outcome = plan(r);
  ASSERT_FALSE(outcome.ok());
  EXPECT_EQ(outcome.error().code, Code::kInterrupted);
  EXPECT_FALSE(fs::exists(folder_ / "job"));
  EXPECT_FALSE(drafts_left());
}

TEST_F(PlanTest, AnExistingPlaceIsNotReplacedUnasked) {
  fs::create_directories(folder_ / "job");
  std::ofstream(folder_ / "job" / "precious.txt") << "mine";
  PlanRequest r = request("box.stl", "low.stl", Mode::kStrict);
  r.replace = false;
  EXPECT_FALSE(plan(r).ok());
  r.replace = true;  // not a job folder either
  EXPECT_FALSE(plan(r).ok());
  EXPECT_TRUE(fs::exists(folder_ / "job" / "precious.txt"));
}

}  // namespace
}  // namespace reforge
