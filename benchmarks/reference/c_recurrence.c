/* The exact step of a diagonal model, row after row: what any program has to do at least.
 *
 *   x <- e x + w0 q0 + w1 q1,   theta <- e theta + e_theta x + v0 q0 + v1 q1,   u = C x + D q,   y = C theta
 *
 * ORDER, SENSORS: fixed when compiled. Two inputs. Row 0 is the start, theta is 0 there. */
#ifndef ORDER
#define ORDER 5
#endif
#ifndef SENSORS
#define SENSORS 5
#endif

void recurrence(long rows, const double *restrict q, const double *restrict e, const double *restrict w0,
                const double *restrict w1, const double *restrict e_theta, const double *restrict v0,
                const double *restrict v1, const double *restrict c, const double *restrict d,
                const double *restrict start, double *restrict u, double *restrict y)
{
    double x[ORDER], theta[ORDER] = {0};
    for (int m = 0; m < ORDER; m++)
        x[m] = start[m];
    for (int s = 0; s < SENSORS; s++) {
        u[s] = d[2 * s] * q[0] + d[2 * s + 1] * q[1];
        for (int m = 0; m < ORDER; m++)
            u[s] += c[ORDER * s + m] * x[m];
        y[s] = 0.0;
    }
    for (long t = 1; t < rows; t++) {
        const double a0 = q[2 * t - 2], a1 = q[2 * t - 1], b0 = q[2 * t], b1 = q[2 * t + 1];
        double next[ORDER];
        for (int m = 0; m < ORDER; m++) {
            next[m] = e[m] * x[m] + w0[2 * m] * a0 + w0[2 * m + 1] * a1 + w1[2 * m] * b0 + w1[2 * m + 1] * b1;
            theta[m] = e[m] * theta[m] + e_theta[m] * x[m] + v0[2 * m] * a0 + v0[2 * m + 1] * a1 + v1[2 * m] * b0
                       + v1[2 * m + 1] * b1;
        }
        for (int m = 0; m < ORDER; m++)
            x[m] = next[m];
        for (int s = 0; s < SENSORS; s++) {
            double sum = d[2 * s] * b0 + d[2 * s + 1] * b1, slope = 0.0;
            for (int m = 0; m < ORDER; m++) {
                sum += c[ORDER * s + m] * x[m];
                slope += c[ORDER * s + m] * theta[m];
            }
            u[SENSORS * t + s] = sum;
            y[SENSORS * t + s] = slope;
        }
    }
}
