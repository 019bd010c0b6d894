#include "import/formats/import.h"

void matrix_multiply(const double a[16], const double b[16], double out[16])
{
    for (int column = 0; column < 4; column++) {
        for (int row = 0; row < 4; row++) {
            double sum = 0.0;
            for (int k = 0; k < 4; k++)
                sum += a[4 * k + row] * b[4 * column + k];
            out[4 * column + row] = sum;
        }
    }
}

double matrix_cofactors(const double m[16], double c[9])
{
    for (int i = 0; i < 3; i++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            c[3 * i + j] = m[4 * i1 + j1] * m[4 * i2 + j2] - m[4 * i1 + j2] * m[4 * i2 + j1];
        }
    }
    return m[0] * c[0] + m[1] * c[1] + m[2] * c[2];
}

bool matrix_inverse(const double m[16], double out[16])
{
    double c[9];
    const double determinant = matrix_cofactors(m, c);

    if (!(fabs(determinant) > 0.0))
        return false;
    for (int row = 0; row < 3; row++) {
        double moved = 0.0;
        for (int column = 0; column < 3; column++) {
            out[4 * column + row] = c[3 * row + column] / determinant;
            moved += out[4 * column + row] * m[12 + column];
        }
        out[12 + row] = -moved;
        out[4 * row + 3] = 0.0;
    }
    out[15] = 1.0;
    return true;
}

void matrix_rows(const double m[16], float rows[3][4])
{
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++)
            rows[row][column] = (float)m[4 * column + row];
}
