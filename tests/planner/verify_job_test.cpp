// A job folder is verified from its files alone, and always to the same bytes.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "planner/geometry/mesh_io.h"
#include "protocols/sha256.h"
#include "tests/planner/verify_world.h"

namespace reforge::verify {
namespace {

namespace fs = std::filesystem;

class VerifyJob : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() /
        ("reforge-verify-" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
         "-" + ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
    const World world;
    write("program.nc", world.text());
    fs::copy_file(std::string(REFORGE_SOURCE_DIR) + "/config/rigs/mx220.json", folder_ / "rig.json",
                  fs::copy_options::overwrite_existing);
    ASSERT_TRUE(write_binary_stl(world.inputs.initial, folder_ / "initial.stl"));
    ASSERT_TRUE(write_binary_stl(*world.inputs.target, folder_ / "target.stl"));
    ASSERT_TRUE(write_binary_stl(*world.inputs.reused, folder_ / "reused.stl"));
    ASSERT_TRUE(write_binary_stl(*world.inputs.removed, folder_ / "removed.stl"));
    ASSERT_TRUE(write_binary_stl(*world.inputs.added, folder_ / "added.stl"));
    ASSERT_TRUE(write_binary_stl(*world.inputs.fixture, folder_ / "fixture.stl"));
    options_.pitch_mm = 0.2;
  }
  void TearDown() override { fs::remove_all(folder_); }
  void write(const char* name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }

  fs::path folder_;
  VerifyOptions options_;
};

TEST_F(VerifyJob, PassesWithTheHashesOfItsFiles) {
  const Result<JobVerification> job = verify_job(folder_, options_);
  ASSERT_TRUE(job) << job.error().sentence;
  EXPECT_TRUE(job->certificate.pass) << all_of(job->verification);
  EXPECT_EQ(job->certificate.sha256.size(), 8u);
  EXPECT_EQ(job->certificate.sha256.at("program"), *sha256_of_file(folder_ / "program.nc"));
  const Result<JobVerification> again = verify_job(folder_, options_);
  EXPECT_EQ(canonical_json(job->certificate), canonical_json(again->certificate));
}

TEST_F(VerifyJob, ThePaperModeIsTheProgramsOwnWord) {
  write("program.nc", "; mode: paper\n" + World().text());
  const Result<JobVerification> job = verify_job(folder_, options_);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->certificate.mode, Mode::kPaper);
}

// Whatever byte changes, the certificate is another one, or there is none.
TEST_F(VerifyJob, AnyChangedByteInvalidatesTheCertificate) {
  const Result<JobVerification> job = verify_job(folder_, options_);
  ASSERT_TRUE(job);
  const std::string right = canonical_json(job->certificate);
  for (const char* name : {"program.nc", "rig.json", "initial.stl", "target.stl", "reused.stl",
                           "removed.stl", "added.stl", "fixture.stl"}) {
    std::ifstream in(folder_ / name, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), {}};
    for (const std::size_t at : {std::size_t{3}, bytes.size() / 2, bytes.size() - 2}) {
      std::string changed = bytes;
      changed[at] = static_cast<char>(changed[at] ^ 1);
      write(name, changed);
      const Result<JobVerification> other = verify_job(folder_, options_);
      const std::string got = other ? canonical_json(other->certificate) : "none";
      EXPECT_NE(got, right) << name << " at " << at;
    }
    write(name, bytes);
  }
  const Result<JobVerification> again = verify_job(folder_, options_);
  ASSERT_TRUE(again);
  EXPECT_EQ(canonical_json(again->certificate), right);
}

TEST_F(VerifyJob, AMissingFileIsNamed) {
  fs::remove(folder_ / "initial.stl");
  const Result<JobVerification> job = verify_job(folder_, options_);
  ASSERT_FALSE(job);
  EXPECT_NE(job.error().sentence.find("initial.stl"), std::string::npos);
}

}  // namespace
}  // namespace reforge::verify
