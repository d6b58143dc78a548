// One line of program text taken apart into words, and the streaming reader of such lines.
//
// Strict: whatever is not blank, comment or word is an error that names line and column and says
// what was expected. A Line is a value; nothing of the program but the present line is held. What
// the words mean is modal.h's business.
#pragma once

#include <array>
#include <cassert>
#include <cstddef>
#include <istream>
#include <optional>
#include <string>
#include <string_view>

#include "protocols/gcode/dialect.h"
#include "protocols/result.h"

namespace reforge::gcode {

struct Word {
  char letter = 0;   // upper case
  double value = 0;  // as written
  int column = 0;    // of the letter in the source line, from 1
};

constexpr std::size_t kWordsMax = 24;  // on one line

struct Line {
  std::size_t number = 0;  // from 1
  std::string text;        // as read, without its end of line
  std::string comment;     // of the last comment on the line, without delimiters and outer blanks
  bool percent = false;    // the tape mark alone
  std::array<Word, kWordsMax> words{};
  std::size_t word_count = 0;

  const Word* begin() const { return words.data(); }
  const Word* end() const { return words.data() + word_count; }
  bool empty() const { return word_count == 0; }  // blank, comment or tape mark
  const Word* find(char letter) const {
    for (const Word& w : *this) {
      if (w.letter == letter) return &w;
    }
    return nullptr;
  }
};

// Takes one line apart. `text` has no end of line. Errors: kMalformed, or kOutOfRange when the line
// is longer than the dialect takes.
Status parse_line(std::string_view text, std::size_t number, const Dialect& dialect, Line& line);

// The same words as short text, without comments and blanks: what goes to a controller.
std::string compact(const Line& line);

// Lines from a stream, one at a time. After an error the reader stands behind the faulty line; a
// caller may go on, but none of ours does.
class LineReader {
 public:
  LineReader(std::istream& in, Dialect dialect) : in_(in), dialect_(dialect) {}

  // False at the end of the stream; true with `line` filled; or the error of that line.
  Result<bool> next(Line& line);

  const Dialect& dialect() const { return dialect_; }
  std::size_t line_number() const { return number_; }  // of the last line read

 private:
  std::istream& in_;
  Dialect dialect_;
  std::size_t number_ = 0;
  std::string buffer_;
};

}  // namespace reforge::gcode
