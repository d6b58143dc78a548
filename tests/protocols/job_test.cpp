#include "protocols/job.h"

#include <gtest/gtest.h>

#include "tests/rig/scratch_folder.h"
#include "tests/support/job_folder.h"

namespace reforge {
namespace {

using namespace reforge::testing;

constexpr const char* kBody = "G21\nG90\nG1 X1 F100\nM30\n";

class JobFolders : public ::testing::Test {
 protected:
  void SetUp() override { make_job(folder_, kBody); }

  Code refused() {
    const auto job = read_job(folder_);
    EXPECT_FALSE(job.ok());
    return job ? Code::kUsage : job.error().code;
  }

  ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path / "bracket";
};

TEST_F(JobFolders, WholeOneIsReadWithItsHashesAndLines) {
  const auto job = read_job(folder_);
  ASSERT_TRUE(job.ok()) << job.error().sentence;
  EXPECT_EQ(job->name, "bracket");
  EXPECT_EQ(job->mode, Mode::kStrict);
  EXPECT_EQ(job->lines, 11 + 4);
  EXPECT_EQ(job->estimated_s, 10.5);
  EXPECT_EQ(job->program_sha256, sha256_hex(read_file(folder_ / "program.nc")));
  EXPECT_EQ(job->rig_sha256, sha256_hex(read_file(shipped_rig_file())));
  EXPECT_EQ(job_files(folder_)->size(), 10u);
}

TEST_F(JobFolders, LastLineCountsWithoutItsEnd) {
  make_job(folder_, "G21\nM30");
  EXPECT_EQ(read_job(folder_)->lines, 11 + 2);
}

TEST_F(JobFolders, AnyChangedFileIsNamed) {
  for (const char* file : {"program.nc", "rig.json", "initial.stl", "target.stl", "fixture.stl",
                           "reused.stl", "removed.stl", "added.stl"}) {
    make_job(folder_, kBody);
    write_file(folder_ / file, read_file(folder_ / file) + " ");
    const auto job = read_job(folder_);
    ASSERT_FALSE(job.ok()) << file;
    EXPECT_EQ(job.error().code, Code::kHashMismatch);
    EXPECT_NE(job.error().sentence.find(file), std::string::npos) << job.error().sentence;
  }
}

TEST_F(JobFolders, MissingFileIsNoJob) {
  std::filesystem::remove(folder_ / "target.stl");
  EXPECT_EQ(refused(), Code::kUnreadable);
}

TEST_F(JobFolders, MissingFolderIsNoJob) {
  std::filesystem::remove_all(folder_);
  EXPECT_EQ(refused(), Code::kUnreadable);
}

TEST_F(JobFolders, CertificateThatBindsTooLittleIsRefused) {
  Certificate certificate = *read_certificate(folder_ / "certificate.json");
  certificate.sha256.erase("fixture");
  write_certificate(folder_, certificate);
  EXPECT_EQ(refused(), Code::kHashMismatch);
}

TEST_F(JobFolders, FailedVerdictIsRefused) {
  Certificate certificate = *read_certificate(folder_ / "certificate.json");
  certificate.pass = false;
  certificate.findings.push_back({"gouge", 1, 14, 1, {}, 0.5, "The cutter enters the part."});
  write_certificate(folder_, certificate);
  EXPECT_EQ(refused(), Code::kNotCertified);
}

TEST_F(JobFolders, OtherCertificateFormatIsRefused) {
  std::string text = read_file(folder_ / "certificate.json");
  text.replace(text.find("reforge-certificate 1"), 21, "reforge-certificate 2");
  write_file(folder_ / "certificate.json", text);
  EXPECT_EQ(refused(), Code::kWrongVersion);
}

TEST_F(JobFolders, CertificateThatIsNoObjectIsRefused) {
  for (const char* text : {"", "[]", "7", "{\"format\":", "\xff\xfe"}) {
    write_file(folder_ / "certificate.json", text);
    EXPECT_EQ(refused(), Code::kMalformed) << text;
  }
}

TEST_F(JobFolders, InfeasiblePlanSaysWhy) {
  write_file(folder_ / "plan.json", R"({"infeasible":{"reasons":["the pit stays blocked"]}})");
  const auto job = read_job(folder_);
  ASSERT_FALSE(job.ok());
  EXPECT_EQ(job.error().code, Code::kNoFeasiblePlan);
  EXPECT_NE(job.error().sentence.find("the pit stays blocked"), std::string::npos);
}

TEST_F(JobFolders, LinkInPlaceOfAFileIsRefused) {
  std::filesystem::remove(folder_ / "program.nc");
  std::filesystem::create_symlink("/dev/zero", folder_ / "program.nc");
  EXPECT_EQ(refused(), Code::kMalformed);
}

}  // namespace
}  // namespace reforge
