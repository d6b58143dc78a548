#include "planner/program/program_writer.h"

#include <cassert>
#include <cstdio>

namespace reforge {

std::string number(double value, int decimals) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, "%.*f", decimals, value);
  std::string text = buffer;
  if (text.find('.') != std::string::npos) {
    while (text.back() == '0') text.pop_back();
    if (text.back() == '.') text.pop_back();
  }
  return text == "-0" ? "0" : text;
}

ProgramWriter::ProgramWriter(const CncLink& link, RotaryTable table)
    : link_(link), tilt_letter_(table == RotaryTable::kBC ? 'B' : 'A') {}

void ProgramWriter::line(const std::string& text) {
  assert(static_cast<int>(text.size()) <= link_.line_length_max);
  text_ += text;
  text_ += '\n';
  ++lines_;
}

void ProgramWriter::begin() {
  if (link_.dialect != CncDialect::kFanuc) return;
  line("%");
  line("O1000");
}

void ProgramWriter::end() {
  line("M30");
  if (link_.dialect == CncDialect::kFanuc) line("%");
}

void ProgramWriter::comment(const std::string& text) {
  const bool parentheses = link_.dialect == CncDialect::kFanuc;
  std::string plain;
  for (const char c : text) plain += c < ' ' || c > '~' || c == '(' || c == ')' ? '_' : c;
  line(parentheses ? "(" + plain + ")" : "; " + plain);
}

void ProgramWriter::header(const std::string& key, const std::string& value) {
  const size_t room = static_cast<size_t>(link_.line_length_max) - 3;
  std::string rest = key + ": " + value;
  bool first = true;
  while (!rest.empty()) {
    const std::string piece = rest.substr(0, first ? room : room - 1);
    rest.erase(0, piece.size());
    comment((first ? "" : "+") + piece);
    first = false;
  }
}

void ProgramWriter::words(const std::string& text) {
  line(text);
}

void ProgramWriter::dwell(double seconds) {
  const bool milliseconds = link_.dialect != CncDialect::kGrbl;
  line("G4 P" + number(milliseconds ? seconds * 1000 : seconds, 3));
}

void ProgramWriter::module_code(int code, char letter, double value, int decimals) {
  std::string text = "M" + std::to_string(code);
  if (letter != 0) text += std::string(" ") + letter + number(value, decimals);
  line(text);
}

std::string ProgramWriter::axis(int index, double value) {
  const char letters[] = {'X', 'Y', 'Z', tilt_letter_, 'C'};
  const std::string text = number(value, 3);
  if (at_[static_cast<size_t>(index)] == text) return "";
  at_[static_cast<size_t>(index)] = text;
  return std::string(" ") + letters[index] + text;
}

void ProgramWriter::motion(int code, const std::string& axes, const std::string& feed) {
  if (axes.empty()) return;
  std::string text = motion_ == code ? axes + feed : "G" + std::to_string(code) + axes + feed;
  motion_ = code;
  if (text.front() == ' ') text.erase(0, 1);
  line(text);
}

void ProgramWriter::rapid(const Point<MachineFrame>& to) {
  motion(0, axis(0, to.x) + axis(1, to.y) + axis(2, to.z), "");
}
void ProgramWriter::rapid_z(double z) {
  motion(0, axis(2, z), "");
}
void ProgramWriter::rapid_xy(double x, double y) {
  motion(0, axis(0, x) + axis(1, y), "");
}

void ProgramWriter::feed(const Point<MachineFrame>& to, double feed_mm_per_s) {
  const std::string axes = axis(0, to.x) + axis(1, to.y) + axis(2, to.z);
  if (axes.empty()) return;
  const std::string wanted = " F" + number(feed_mm_per_s * 60, 1);
  motion(1, axes, wanted == feed_ ? "" : wanted);
  feed_ = wanted;
}

void ProgramWriter::turn(double tilt_deg, double c_deg) {
  // Said in full, with its G0: the line must make sense alone.
  const std::string tilt = number(tilt_deg, 3), c = number(c_deg, 3);
  if (at_[3] == tilt && at_[4] == c) return;
  at_[3] = tilt;
  at_[4] = c;
  motion_ = 0;
  line(std::string("G0 ") + tilt_letter_ + tilt + " C" + c);
}

}  // namespace reforge
